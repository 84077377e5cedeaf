"""`ros2 run power_lab discover`: an effect that no catalogue has, learned and written down."""

from collections.abc import Sequence
from pathlib import Path

from wattwalk_core.command import command
from wattwalk_core.console import check_suffix, progress, write_json
from wattwalk_core.files import together, write_whole

from power_lab.commands import options as common


@command
def main(args: Sequence[str] | None = None) -> int:
    """Entry point."""
    parser = common.parser(
        'discover',
        'Learn what a model misses and no catalogue has: what it depends on, its shape and a '
        'formula, written as an effect that add takes. Where nothing is found no file is written. '
        'Of several recordings the last tests what the others show, unless --test names one.',
        'example: ros2 run power_lab discover bags/walk --test bags/other --model base.yaml '
        '-o effect.py --report why.html',
    )
    common.add_bags(parser)
    add = parser.add_argument
    add('--model', required=True, metavar='MODEL', help='model.yaml, ppn:RUN or a proxy')
    add('-o', '--output', type=Path, required=True, metavar='FILE.py', help='effects to write')
    add(
        '--test',
        nargs='+',
        default=[],
        type=Path,
        metavar='BAG',
        help='other recordings of the robot, to test the effects on',
    )
    add('--seed', type=int, default=0, help='of the bootstrap')
    common.add_outputs(parser)
    options = parser.parse_args(args)
    check_suffix(options.output, '-o', ('.py',))
    check_suffix(options.report, '--report', ('.html',))
    common.check_bags([*options.bags, *options.test])
    catalogue = common.catalogue_of(options)
    common.check_models([options.model], catalogue)

    from power_estimator.judge.recordings import load

    from power_lab.compare.comparison import open_model
    from power_lab.discover.outcome import discover, split
    from power_lab.report.discovery_tables import print_discovery

    model = open_model(options.model, catalogue)
    doubts = {'slow': options.slow, 'anyway': options.anyway}
    bags, tests = split(options.bags, options.test)
    with progress('reading') as show:
        loaded = load(bags, options.drives, **doubts)
        test = load(tests, options.drives, **doubts) if tests else None
        outcome = discover(loaded, model, options.model, catalogue, test, show, options.seed)
        content = outcome.json()
    print_discovery(common.console(), outcome)
    with together():
        if outcome.written:
            write_whole(options.output, outcome.source())
        if options.json is not None:
            write_json(options.json, content)
        if options.report:
            from power_lab.report.discovery_page import write_discovery

            write_discovery(options.report, outcome)
    names = [one.name for one in outcome.discovery.named]
    names += [one.name for one in outcome.written]
    own = f' --effects-path {options.output}' if outcome.written else ''
    told = f'wrote {options.output}'
    if not outcome.written:
        told = f'{options.output} is not written: there is no effect of the drives to write down'
    if names:
        told += (
            f'; to add what is missing: ros2 run power_lab add {" ".join(names)} --to '
            f'{options.model} --bag {options.bags[0]} -o better.yaml{own}'
        )
    print(told)
    if options.report:
        print(f'report: {options.report}')
    return 0
