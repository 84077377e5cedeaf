"""`ros2 run power_lab fit`: coefficients of named effects from recordings."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from wattwalk_core.command import command
from wattwalk_core.console import check_suffix, progress, write_json
from wattwalk_core.errors import InputError
from wattwalk_core.files import together

from power_lab.commands import options as common


@command
def main(args: Sequence[str] | None = None) -> int:
    """Entry point."""
    parser = common.parser(
        'fit',
        'Fit a power model made of named effects; errors of the measurement are fitted beside '
        'them.',
        'example: ros2 run power_lab fit bags/walk --effects shaft,copper_loss,idle -o base.yaml',
    )
    common.add_bags(parser)
    add = parser.add_argument
    add('--effects', nargs='+', required=True, metavar='NAME,…', help='what is active')
    add('-o', '--output', type=Path, required=True, metavar='MODEL.yaml', help='file to write')
    add('--per', choices=('type', 'drive'), default='type', help='who shares coefficients')
    add('--base', metavar='MODEL', help='add the effects to this model: ppn:RUN or a proxy')
    add('--seed', type=int, default=0, help='of the bootstrap')
    common.add_outputs(parser, report=False)
    options = parser.parse_args(args)
    check_suffix(options.output, '-o', ('.yaml',))
    if options.base and options.base.endswith('.yaml'):
        raise InputError(f'--base {options.base!r}: give ppn:RUN or a proxy; add effects by add')
    common.check_bags(options.bags)
    catalogue = common.catalogue_of(options)
    effects = common.parse_effects(options.effects, catalogue)

    from power_estimator.effects.model_file.yaml_file import write_model
    from power_estimator.judge.judge import Judge
    from power_estimator.judge.recordings import load

    from power_lab.compare.fitting import fitted
    from power_lab.report.balance import balance_lines, balances_json, power_balances
    from power_lab.report.tables import notes, print_model

    with progress('reading and fitting'):
        loaded = load(options.bags, options.drives, slow=options.slow, anyway=options.anyway)
        model, own = fitted(
            Judge(loaded, catalogue),
            effects,
            options.output.stem,
            base=options.base,
            per=options.per,
            seed=options.seed,
        )
    (entry,) = model.history
    rmse = entry['rmse_w']
    balances = power_balances(loaded.data)
    content = {
        'model': str(options.output),
        **entry,
        'at_bound': list(model.at_bound),
        'measurement': {
            group.type.name: {
                name: {**asdict(value), 'at_bound': value.at_bound or None}
                for name, value in group.measurement.items()
            }
            for group in model.groups
        },
        'power_balance': balances_json(balances),
    }
    with together():
        write_model(model, options.output)
        if options.json is not None:
            write_json(options.json, content)
    for line in balance_lines(loaded.data, balances):
        print(line)
    print_model(common.console(), model)
    for note in notes(own.prepared):
        print(note)
    print(f'wrote {options.output}; held-out error: ' + _errors(rmse))
    return 0


def _errors(rmse: dict[str, float]) -> str:
    return ', '.join(f'{drive} {value:.2f} W' for drive, value in rmse.items())
