"""`ros2 run power_lab add`: put an effect into a model, refit all, keep the history."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from wattwalk_core.command import command
from wattwalk_core.console import check_suffix, progress, write_json
from wattwalk_core.errors import InputError
from wattwalk_core.files import together

from power_lab.commands import options as common

if TYPE_CHECKING:
    from power_estimator.effects.model_file.model import EffectModel


@command
def main(args: Sequence[str] | None = None) -> int:
    """Entry point."""
    parser = common.parser(
        'add',
        'Add an effect to a model: all coefficients are fitted anew, the history is kept.',
        'example: ros2 run power_lab add load_friction --to base.yaml --bag bags/walk '
        '-o better.yaml',
    )
    add = parser.add_argument
    add('effects', nargs='+', metavar='EFFECT', help='what to add')
    add('--to', required=True, type=Path, metavar='MODEL.yaml', help='the model as it is')
    add('--bag', required=True, nargs='+', type=Path, metavar='BAG', help='recordings to fit on')
    add('--drives', nargs='+', default=[], metavar='NAME', help='only these')
    common.add_doubts(parser)
    add('-o', '--output', type=Path, required=True, metavar='MODEL.yaml', help='file to write')
    add('--per', choices=('type', 'drive'), default='type', help='who shares coefficients')
    add('--seed', type=int, default=0, help='of the bootstrap')
    common.add_outputs(parser, report=False)
    options = parser.parse_args(args)
    check_suffix(options.output, '-o', ('.yaml',))
    common.check_bags(options.bag)
    catalogue = common.catalogue_of(options)

    from power_estimator.effects.model_file.yaml_file import read_model, write_model

    model = read_model(options.to, catalogue)
    new = common.parse_effects(options.effects, catalogue)
    for active in new:
        if active.name in model.effects:
            raise InputError(f'{active.name!r} is active in {options.to} already')

    from power_estimator.judge.judge import Judge
    from power_estimator.judge.recordings import load

    from power_lab.compare.fitting import extended
    from power_lab.report.tables import print_model

    with progress('reading and fitting'):
        loaded = load(options.bag, options.drives, slow=options.slow, anyway=options.anyway)
        better = extended(
            Judge(loaded, catalogue),
            model,
            new,
            options.output.stem,
            per=options.per,
            seed=options.seed,
        )
    content = {
        'model': str(options.output),
        'history': [dict(e) for e in better.history],
        'at_bound': list(better.at_bound),
    }
    with together():
        write_model(better, options.output)
        if options.json is not None:
            write_json(options.json, content)
    print_model(common.console(), better)
    _print_staircase(better)
    print(f'wrote {options.output}')
    return 0


def _print_staircase(model: 'EffectModel') -> None:
    print('held-out error over the drives, on the recordings of each step:')
    for entry in model.history:
        label = ', '.join(entry.get('added', entry.get('effects', [])))
        before = entry.get('rmse_before_w')
        start = f'{_mean(before):.3f} → ' if before else ''
        after = f'{_mean(entry.get("rmse_w", {})):.3f} W'
        print(f'{entry.get("step", "?"):>4}  {start}{after}  {label}')


def _mean(errors: Mapping[str, float]) -> float:
    values = list(errors.values()) or [0.0]
    return math.sqrt(math.fsum(value**2 for value in values) / len(values))
