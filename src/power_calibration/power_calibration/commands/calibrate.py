"""`ros2 run power_calibration calibrate`: gains and offsets against a certified analyser."""

import argparse
import datetime
from pathlib import Path
from typing import Any

from power_recordings.reading.bag_folder import check_recordings
from power_recordings.reading.reader import Recording
from wattwalk_core.console import output, print_table, progress, write_json
from wattwalk_core.errors import InputError
from wattwalk_core.files import together

from power_calibration.analyser.compare import compare_with_analyser
from power_calibration.analyser.curve import MeasuredDrive
from power_calibration.analyser.figure import (
    COLUMNS,
    calibration_sentences,
    rows,
    write_calibration,
)
from power_calibration.analyser.log import Log
from power_recordings import calibration


def run(options: argparse.Namespace) -> None:
    """Compare, and write the calibration and requested outputs; InputError for bad input."""
    check_recordings([options.recording])
    with progress(f'reading {options.recording}') as show:
        measured = MeasuredDrive.of(Recording.open(options.recording), options.drive)
        kept, is_applied = _kept(options.onto, measured)
        size = max(options.reference.stat().st_size, 1)

        def reading(position: int) -> None:
            show(f'reading {options.reference} {min(1.0, position / size):.0%}')

        found = compare_with_analyser(
            measured, Log.read(options.reference, options.columns, reading), show
        )
        content = found.json()
        with together():
            _save(options, content, kept, is_applied)
            write_json(options.json, content)
            if options.report is not None:
                show(f'drawing {options.report}')
                write_calibration(options.report, found)
    console = output()
    print_table(console, COLUMNS, rows(found), title=found.measured.drive)
    for sentence in calibration_sentences(found):
        console.print(sentence, soft_wrap=True)
    for note in found.notes:
        console.print(note, style='yellow', soft_wrap=True)
    for path in (options.output, options.json, options.report):
        if path is not None:
            print(path)
    print(f'next: ros2 run power_daq daq --ros-args -p calibration:={options.output}')


def _kept(onto: Path | None, measured: MeasuredDrive) -> tuple[dict[str, object], bool]:
    """Return the channels of an existing calibration, and whether it was applied."""
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
    return calibration.read_channels(onto)[0], applied


def _save(
    options: argparse.Namespace, content: dict[str, Any], kept: dict[str, object], is_applied: bool
) -> None:
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
