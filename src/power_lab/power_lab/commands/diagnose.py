"""`ros2 run power_lab diagnose`: which physical effect a model misses."""

from collections.abc import Sequence
from pathlib import Path

from wattwalk_core.command import command
from wattwalk_core.console import check_suffix, progress, write_json
from wattwalk_core.engine.options import Workplace, add_workplace
from wattwalk_core.files import together

from power_lab.commands import options as common


@command
def main(args: Sequence[str] | None = None) -> int:
    """Entry point."""
    parser = common.parser(
        'diagnose',
        'Find the physical effect that a power model misses, or say honestly that these '
        'recordings cannot tell. Ends with 0 for every verdict.',
        'example: ros2 run power_lab diagnose bags/walk --model base.yaml --report why.html',
    )
    common.add_bags(parser)
    add = parser.add_argument
    add('--model', required=True, metavar='MODEL', help='model.yaml, ppn:RUN or a proxy')
    add('--motion', type=Path, metavar='FILE.yaml', help='write what to record next')
    add(
        '--limits',
        nargs='?',
        const='',
        metavar='FILE',
        help='fit that motion to joint_limits/1; without a file: to the limits of ANYmal C',
    )
    add('--also', nargs='+', default=[], metavar='MODEL', help='models to show beside it')
    add('--seed', type=int, default=0, help='of the bootstrap')
    add_workplace(parser, 'recordings read')
    common.add_outputs(parser)
    options = parser.parse_args(args)
    place = Workplace.of(options)
    check_suffix(options.report, '--report', ('.html',))
    check_suffix(options.motion, '--motion', ('.yaml',))
    common.check_bags(options.bags)
    catalogue = common.catalogue_of(options)
    common.check_models([options.model, *options.also], catalogue)

    from drive_bench.motion.joint_limits import limits_of
    from power_estimator.judge.recordings import load

    from power_lab.compare.comparison import open_model
    from power_lab.diagnose.outcome import diagnose
    from power_lab.report.balance import balance_lines, power_balances
    from power_lab.report.tables import print_outcome

    model = open_model(options.model, catalogue)
    with progress('reading') as show:
        with common.reading_engine(place, options.bags) as engine:
            doubts = {'slow': options.slow, 'anyway': options.anyway}
            loaded = load(options.bags, options.drives, **doubts, engine=engine, show=show)
        show('diagnosing')
        outcome = diagnose(loaded, model, options.model, catalogue, options.seed)
        content = outcome.json()
    for line in balance_lines(loaded.data, power_balances(loaded.data)):
        print(line)
    print_outcome(common.console(), outcome)
    with together():
        if options.json is not None:
            write_json(options.json, content)
        if options.motion:
            motion = outcome.motion
            if options.limits is not None:
                limits = limits_of(motion.drives, Path(options.limits) if options.limits else None)
                motion = motion.within(limits)
            motion.save(options.motion)
        if options.report:
            from power_lab.report.page import write_diagnosis

            write_diagnosis(options.report, outcome, options.also, catalogue)
    if options.motion:
        print(f'to record next: {options.motion}')
    if options.report:
        print(f'report: {options.report}')
    return 0
