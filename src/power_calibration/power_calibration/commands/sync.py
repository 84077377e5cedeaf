"""`ros2 run power_daq sync`: how well electrical and joint streams agree in time."""

import argparse
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

from power_calibration.timing.summary import MATTERS, Summary, summarise

_PICTURES = ('.png', '.svg', '.pdf')
_EPILOG = """\
examples:
  ros2 run power_daq sync bags/walk_small
  ros2 run power_daq sync bags/walk_1 --drives LF_KFE RF_KFE --report sync.html --json sync.json
"""


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='ros2 run power_daq sync',
        description='Measure by how much electrical samples are late against joint samples, what '
        'that does to power, and how even the stamps of each stream are.',
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add('recording', type=Path, metavar='BAG')
    add('--drives', nargs='+', metavar='NAME', help='only these')
    add('--json', type=Path, metavar='F', help='the figures')
    add('--report', type=Path, metavar='F', help='page (.html) or picture (.png, .svg, .pdf)')
    return parser


@command
def main(args: Sequence[str] | None = None) -> int:
    """Measure and report; 2 for bad input."""
    given = list(sys.argv if args is None else ['sync', *args])
    options = _parser().parse_args(remove_ros_args(given)[1:])
    if options.report is not None and options.report.suffix not in ('.html', *_PICTURES):
        raise InputError(
            f'--report {str(options.report)!r}: end it in .html, {", ".join(_PICTURES)}'
        )
    columns = (SpinnerColumn(), TextColumn('{task.description}'), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(f'reading {options.recording}')
        recording = Recording.open(options.recording)
        found = summarise(
            recording, options.drives, lambda text: progress.update(task, description=text)
        )
        if options.json is not None:
            text = json.dumps(found.json(), indent=1, allow_nan=False)
            write_whole(options.json, text + '\n')
        if options.report is not None:
            progress.update(task, description=f'drawing {options.report}')
            _report(options.report, found)
    _show(found)
    for path in (options.json, options.report):
        if path is not None:
            print(path)
    common = found.common
    if common is not None and abs(common.value) > MATTERS:
        print(
            f'next: ros2 run power_lab fit {options.recording} --effects '
            'shaft,copper_loss,rotor_inertia,idle -o base.yaml   (it fits time_offset as well)'
        )
    elif options.report is None:
        print(f'next: ros2 run power_daq sync {options.recording} --report sync.html')
    else:
        print(f'next: ros2 run power_estimator train {options.recording} -o runs/first')
    return 0


def _report(path: Path, found: Summary) -> None:
    if path.suffix == '.html':
        from power_calibration.timing.page import write_page

        write_page(path, found)
    else:
        from wattwalk_core.figures import save_figure

        from power_calibration.timing.figure import draw

        save_figure(draw(found), path)


def _show(found: Summary) -> None:
    from power_calibration.timing.page import (
        DRIVE_COLUMNS,
        STREAM_COLUMNS,
        drive_rows,
        stream_rows,
    )

    console = Console(width=None if sys.stdout.isatty() else 140, highlight=False)
    for columns, rows in (
        (DRIVE_COLUMNS, drive_rows(found)),
        (STREAM_COLUMNS, stream_rows(found)),
    ):
        table = Table(box=SIMPLE_HEAD)
        for place, name in enumerate(columns):
            table.add_column(name, justify='left' if not place else 'right', no_wrap=True)
        for row in rows:
            table.add_row(*row)
        console.print(table)
    for answer in found.answers:
        half = answer.current_half
        console.print(
            f'{answer.drive}: current has half its answer {1e3 * half.value:.2f} ms after '
            f'{answer.events} jumps of command ({1e3 * half.low:.2f} to {1e3 * half.high:.2f}), '
            f'torque after {1e3 * answer.torque_half.value:.2f} ms',
            soft_wrap=True,
        )
    if found.clock is not None:
        console.print(
            f'device clock {found.clock.drift:+.2f} ppm; stamps follow it within '
            f'{1e6 * found.clock.spread:.2f} µs (p99 {1e6 * found.clock.worst:.2f} µs)'
        )
    console.print(found.verdict, soft_wrap=True)
    for problem in found.problems:
        console.print(problem, style='yellow', soft_wrap=True)
