"""`ros2 run power_fleet track`: which effect of which drive changes over many recordings."""

from collections.abc import Sequence

from power_lab.commands import options as common
from wattwalk_core.command import command
from wattwalk_core.console import check_suffix, progress, write_json
from wattwalk_core.engine.options import Workplace, add_workplace
from wattwalk_core.files import together


@command
def main(args: Sequence[str] | None = None) -> int:
    """Entry point."""
    parser = common.parser(
        'track',
        'Fit one model to each of many recordings and find what changes over time: an effect of '
        'a drive, or an error of its meter. At most one of twenty quiet histories raises an '
        'alarm. Recordings are taken in the order of their time.',
        'example: ros2 run power_fleet track bags/day_* --model base.yaml --json t.json '
        '--report t.html',
        package='power_fleet',
    )
    common.add_bags(parser)
    parser.add_argument('--model', required=True, metavar='MODEL.yaml', help='model of effects')
    add_workplace(parser, 'recordings')
    common.add_outputs(parser)
    options = parser.parse_args(args)
    place = Workplace.of(options)
    check_suffix(options.report, '--report', ('.html',))
    common.check_bags([path for path in options.bags if not path.exists()])
    catalogue = common.catalogue_of(options)
    common.check_models([options.model], catalogue)

    from power_lab.compare.comparison import open_model
    from power_recordings.index.store import RecordingIndex, usual_path
    from threadpoolctl import threadpool_limits
    from wattwalk_core.engine.task_engine import TaskEngine

    from power_fleet.report.tables import print_tracked
    from power_fleet.track.kept_fit import key_of
    from power_fleet.track.outcome import model_of, track
    from power_fleet.track.reading import Request

    model = model_of(open_model(options.model, catalogue), options.model)
    how = (options.drives, options.slow, options.anyway)
    key = key_of(model, options.model, options.effects_path, how)
    request = Request(model, catalogue, options.model, *how, key)
    with progress('reading') as show, threadpool_limits(limits=1):
        with RecordingIndex(usual_path()) as index, TaskEngine(place) as engine:
            found = track(options.bags, request, index, engine, show)
        content = found.json()
    print_tracked(common.console(), found)
    with together():
        if options.json is not None:
            write_json(options.json, content)
        if options.report:
            from power_fleet.report.page import write_tracked

            write_tracked(options.report, found)
    if options.report:
        print(f'report: {options.report}')
    print(f'next: {found.next_command(options.model)}')
    return 0
