"""`ros2 run power_calibration sync`: agreement in time of electrical and joint streams."""

import argparse

from power_recordings.reading.bag_folder import check_recordings
from power_recordings.reading.reader import Recording
from wattwalk_core.console import output, print_table, progress, write_json

from power_calibration.timing.figure import (
    DRIVE_COLUMNS,
    STREAM_COLUMNS,
    drive_rows,
    stream_rows,
    write_timing,
)
from power_calibration.timing.summary import MATTERS, Summary, summarise


def run(options: argparse.Namespace) -> None:
    """Measure the delays of a recording and report them; InputError for bad input."""
    check_recordings([options.recording])
    with progress(f'reading {options.recording}') as show:
        found = summarise(Recording.open(options.recording), options.drives, show)
        write_json(options.json, found.json())
        if options.report is not None:
            show(f'drawing {options.report}')
            write_timing(options.report, found)
    _print(found)
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
        print(f'next: ros2 run power_calibration sync {options.recording} --report sync.html')
    else:
        print(f'next: ros2 run power_estimator train {options.recording} -o runs/first')


def _print(found: Summary) -> None:
    console = output(140)
    print_table(console, DRIVE_COLUMNS, drive_rows(found))
    print_table(console, STREAM_COLUMNS, stream_rows(found))
    for answer in found.responses:
        half = answer.current_half
        console.print(
            f'{answer.drive}: current reaches half of its response {1e3 * half.value:.2f} ms '
            f'after {answer.events} steps of the command ({1e3 * half.low:.2f} to '
            f'{1e3 * half.high:.2f}), torque after {1e3 * answer.torque_half.value:.2f} ms',
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
