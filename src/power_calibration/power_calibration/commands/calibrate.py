"""`ros2 run power_calibration calibrate`: gains and offsets against a certified analyser."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wattwalk_core.command import command, command_parser, own_arguments
from wattwalk_core.console import (
    PICTURES,
    check_suffix,
    output,
    print_table,
    progress,
    write_json,
)
from wattwalk_core.errors import InputError
from wattwalk_core.files import together

if TYPE_CHECKING:
    from power_calibration.analyser.comparison import AnalyserComparison
    from power_calibration.analyser.measured_drive import MeasuredDrive

_EPILOG = """\
The analyser's CSV may have any dialect, 20 Hz to 1 MHz, and seconds, dates or an epoch on a clock
of its own. It is aligned with the recording by correlation: the motion has to begin, end or vary
within both. Columns are identified by their heads, or by --columns.

examples:
  ros2 run power_calibration calibrate bags/fig2 --reference fig2.csv -o calibration.yaml \\
      --report fig2.html
  ros2 run power_calibration calibrate bags/hfe --reference hfe.csv -o calibration.yaml \\
      --onto calibration.yaml --columns "time=1,voltage=U1,current=I1*0.001"
  ros2 run power_daq daq --ros-args -p calibration:=calibration.yaml
"""


def _parse(args: Sequence[str]) -> argparse.Namespace:
    parser = command_parser(
        'power_calibration calibrate',
        'Compare one drive of a recording with the log of a certified power analyser: '
        'align the two, fit gain and offset of voltage and current with intervals, state the '
        'bandwidth, and write the file that the DAQ node applies.',
        _EPILOG,
    )
    add = parser.add_argument
    add('recording', type=Path, metavar='BAG')
    add('--reference', type=Path, required=True, metavar='CSV', help="the analyser's log")
    add('-o', '--output', type=Path, required=True, metavar='YAML', help='file to write')
    add('--drive', metavar='NAME', help='the drive in the log, if several were measured')
    add(
        '--columns',
        default='',
        metavar='MAP',
        help='time=NAME,voltage=NAME,current=NAME,power=NAME; a head or a number from 1, with '
        '*scale if needed',
    )
    add(
        '--onto',
        type=Path,
        metavar='YAML',
        help='keep its other channels; if it was applied to the recording, the two are combined',
    )
    add('--json', type=Path, metavar='F', help='results as JSON')
    add('--report', type=Path, metavar='F', help='page (.html) or picture (.png, .svg, .pdf)')
    options = parser.parse_args(args)
    check_suffix(options.report, '--report', ('.html', *PICTURES))
    check_suffix(options.output, '--output', ('.yaml', '.yml'))
    if not options.reference.is_file():
        raise InputError(f'cannot read {options.reference}: there is no such file')
    return options


@command
def main(args: Sequence[str] | None = None) -> int:
    """Compare, and write the calibration and the outputs asked for; 2 for bad input."""
    options = _parse(own_arguments(args))
    from power_recordings.reading.bag_folder import check_recordings
    from power_recordings.reading.reader import Recording

    check_recordings([options.recording])

    from power_calibration.analyser.compare import compare
    from power_calibration.analyser.log import Log
    from power_calibration.analyser.measured_drive import MeasuredDrive

    with progress(f'reading {options.recording}') as show:
        measured = MeasuredDrive.of(Recording.open(options.recording), options.drive)
        kept, is_applied = _kept(options.onto, measured)
        size = max(options.reference.stat().st_size, 1)

        def reading(position: int) -> None:
            show(f'reading {options.reference} {min(1.0, position / size):.0%}')

        found = compare(measured, Log.read(options.reference, options.columns, reading), show)
        content = found.json()
        with together():
            _save(options, content, kept, is_applied)
            if options.json is not None:
                write_json(options.json, content)
            if options.report is not None:
                show(f'drawing {options.report}')
                _report(options.report, found)
    _print(found)
    for path in (options.output, options.json, options.report):
        if path is not None:
            print(path)
    print(f'next: ros2 run power_daq daq --ros-args -p calibration:={options.output}')
    return 0


def _kept(onto: Path | None, measured: 'MeasuredDrive') -> tuple[dict[str, object], bool]:
    """Return the channels of an existing calibration, and whether it was applied."""
    from power_recordings import calibration

    applied = measured.calibration not in ('', calibration.NONE)
    if onto is None:
        if applied:
            raise InputError(
                f'{measured.path} was recorded with {measured.calibration}: give that file as '
                '--onto, so that the two are combined'
            )
        return {}, False
    if applied and calibration.label(onto) != measured.calibration:
        raise InputError(
            f'{measured.path} was recorded with {measured.calibration}, but --onto {onto} is '
            f'{calibration.label(onto)}: give the file it was recorded with'
        )
    return dict(calibration.channels_of(onto)), applied


def _save(
    options: argparse.Namespace, content: dict[str, Any], kept: dict[str, object], is_applied: bool
) -> None:
    import datetime

    from power_recordings import calibration

    def rounded(value: Any) -> Any:
        if isinstance(value, list):
            return [rounded(edge) for edge in value]
        return float(f'{value:.7g}')

    keys = ('gain', 'gain_interval', 'offset', 'offset_interval')
    fresh = {
        name: {key: rounded(channel[key]) for key in keys}
        for name, channel in content['channels'].items()
    }
    if is_applied:
        fresh = calibration.onto(options.onto, fresh)
    about = {
        'recording': str(options.recording),
        'reference': options.reference.name,
        'created': datetime.datetime.now(datetime.UTC).isoformat(timespec='seconds'),
        **{key: round(content[key], 4) for key in ('rmse_before_w', 'rmse_after_w')},
    }
    calibration.save(options.output, {**kept, **fresh}, about)


def _report(path: Path, found: 'AnalyserComparison') -> None:
    if path.suffix == '.html':
        from power_calibration.analyser.page import write_page

        write_page(path, found)
    else:
        from wattwalk_core.figures import save_figure

        from power_calibration.analyser.figure import draw

        save_figure(draw(found), path)


def _print(found: 'AnalyserComparison') -> None:
    from power_calibration.analyser.summary import COLUMNS, rows, sentences

    console = output()
    print_table(console, COLUMNS, rows(found), title=found.measured.drive)
    for sentence in sentences(found):
        console.print(sentence, soft_wrap=True)
    for note in found.notes:
        console.print(note, style='yellow', soft_wrap=True)
