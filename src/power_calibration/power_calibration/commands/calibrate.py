"""`ros2 run power_daq calibrate`: gains and offsets against a certified power analyser."""

import argparse
import datetime
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from power_recordings.reading.reader import Recording
from rclpy.utilities import remove_ros_args
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table
from wattwalk_core.command import command
from wattwalk_core.errors import InputError
from wattwalk_core.files import write_whole

from power_calibration.analyser.comparison import Comparison, compare
from power_calibration.analyser.log import Log
from power_calibration.analyser.measured import Measured
from power_recordings import calibration

_PICTURES = ('.png', '.svg', '.pdf')
_EPILOG = """\
The analyser's CSV may have any dialect, 20 Hz to 1 MHz, seconds, dates or an epoch, on a clock of
its own; its place in the recording is found by correlation, so that motion has to begin, end or
vary within both. Columns go by their heads, or by --columns.

examples:
  ros2 run power_daq calibrate bags/fig2 --reference fig2.csv -o calibration.yaml \\
      --report fig2.html
  ros2 run power_daq calibrate bags/hfe --reference hfe.csv -o calibration.yaml \\
      --onto calibration.yaml --columns "time=1,voltage=U1,current=I1*0.001"
  ros2 run power_daq daq --ros-args -p calibration:=calibration.yaml
"""


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='ros2 run power_daq calibrate',
        description='Compare one drive of a recording with the log of a certified power analyser: '
        'align the two, fit gain and offset of voltage and current with intervals, state the '
        'bandwidth, and write the file that the DAQ node applies.',
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add('recording', type=Path, metavar='BAG')
    add('--reference', type=Path, required=True, metavar='CSV', help="the analyser's log")
    add('-o', '--output', type=Path, required=True, metavar='YAML', help='file to write')
    add('--drive', metavar='NAME', help='which one it saw, if several were measured')
    add(
        '--columns',
        default='',
        metavar='MAP',
        help='time=NAME,voltage=NAME,current=NAME,power=NAME; a head or a number from 1, with '
        '*scale if need be',
    )
    add(
        '--onto',
        type=Path,
        metavar='YAML',
        help='keep its other channels; if it was applied to the recording, the two are combined',
    )
    add('--json', type=Path, metavar='F', help='the figures')
    add('--report', type=Path, metavar='F', help='page (.html) or picture (.png, .svg, .pdf)')
    return parser


@command
def main(args: Sequence[str] | None = None) -> int:
    """Compare, write the calibration and what was asked for; 2 for bad input."""
    given = list(sys.argv if args is None else ['calibrate', *args])
    options = _parser().parse_args(remove_ros_args(given)[1:])
    _check(options)
    columns = (SpinnerColumn(), TextColumn('{task.description}'), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(f'reading {options.recording}')
        recording = Recording.open(options.recording)
        measured = Measured.of(recording, options.drive)
        kept = _kept(options.onto, measured)
        size = options.reference.stat().st_size
        read = 0

        def reading(count: int) -> None:
            nonlocal read
            read += count
            share = f'{min(1.0, read / max(size, 1)):.0%}'
            progress.update(task, description=f'reading {options.reference} {share}')

        log = Log.read(options.reference, options.columns, reading)
        found = compare(measured, log, lambda text: progress.update(task, description=text))
        _save(options, found, kept)
        content = found.json()
        if options.json is not None:
            write_whole(options.json, json.dumps(content, indent=1, allow_nan=False) + '\n')
        if options.report is not None:
            progress.update(task, description=f'drawing {options.report}')
            _report(options.report, found)
    _show(found)
    for path in (options.output, options.json, options.report):
        if path is not None:
            print(path)
    print(f'next: ros2 run power_daq daq --ros-args -p calibration:={options.output}')
    return 0


def _check(options: argparse.Namespace) -> None:
    if options.report is not None and options.report.suffix not in ('.html', *_PICTURES):
        raise InputError(
            f'--report {str(options.report)!r}: end it in .html, {", ".join(_PICTURES)}'
        )
    if options.output.suffix not in ('.yaml', '.yml'):
        raise InputError(f'--output {str(options.output)!r}: end it in .yaml')
    if not options.reference.is_file():
        raise InputError(f'cannot read {options.reference}: there is no such file')


def _kept(onto: Path | None, measured: Measured) -> tuple[dict[str, object], bool]:
    """Channels that are there already, and whether the recording was made with them."""
    applied = measured.calibration not in ('', calibration.NONE)
    if onto is None:
        if applied:
            raise InputError(
                f'{measured.path} was recorded with {measured.calibration}: give that file as '
                '--onto, so that what is found is combined with it'
            )
        return {}, False
    if applied and calibration.label(onto) != measured.calibration:
        raise InputError(
            f'{measured.path} was recorded with {measured.calibration}, but --onto {onto} is '
            f'{calibration.label(onto)}: give the file it was recorded with'
        )
    return dict(calibration.channels_of(onto)), applied


def _save(
    options: argparse.Namespace, found: Comparison, kept: tuple[dict[str, object], bool]
) -> None:
    old, applied = kept
    content = found.json()
    fresh = {
        name: {
            key: [float(f'{edge:.7g}') for edge in value]
            if isinstance(value, list)
            else float(f'{value:.7g}')
            for key, value in channel.items()
            if key in ('gain', 'gain_interval', 'offset', 'offset_interval')
        }
        for name, channel in content['channels'].items()
    }
    if applied:
        fresh = calibration.onto(options.onto, fresh)
    about = {
        'recording': str(options.recording),
        'reference': options.reference.name,
        'created': datetime.datetime.now(datetime.UTC).isoformat(timespec='seconds'),
        'rmse_before_w': round(found.before, 4),
        'rmse_after_w': round(found.after, 4),
    }
    calibration.save(options.output, {**old, **fresh}, about)


def _report(path: Path, found: Comparison) -> None:
    from power_calibration.analyser.figure import draw

    if path.suffix == '.html':
        from power_calibration.analyser.page import write_page

        write_page(path, found)
    else:
        from wattwalk_core.figures import save_figure

        save_figure(draw(found), path)


def _show(found: Comparison) -> None:
    from power_calibration.analyser.summary import rows, sentences

    console = Console(width=None if sys.stdout.isatty() else 100, highlight=False)
    table = Table(title=found.measured.drive, title_justify='left', box=SIMPLE_HEAD)
    for place, name in enumerate(('', 'value', '95 % from', 'to')):
        table.add_column(name, justify='left' if place == 0 else 'right', no_wrap=True)
    for row in rows(found):
        table.add_row(*row)
    console.print(table)
    for sentence in sentences(found):
        console.print(sentence, soft_wrap=True)
    for note in found.notes:
        console.print(note, style='yellow', soft_wrap=True)
