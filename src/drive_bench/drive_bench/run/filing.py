"""Filing of a recording after its motion: closed, completed by its card, checked."""

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import TextIO

from power_recordings.card import Card
from wattwalk_core.errors import InputError
from wattwalk_core.files import write_whole

from drive_bench.run.motion_run import MotionRun
from drive_bench.run.recorder_process import RecorderProcess
from drive_bench.run.recording_check import check, check_table


def file_away(
    run: MotionRun,
    recorder: RecorderProcess,
    reason: str,
    report: Path | None,
    out: TextIO,
) -> int:
    """
    End the recorder, write the card, check the bag and print the table.

    report: a JSON file for the check. Returns 1 if the recording is of no use, else 0.
    """
    died = recorder.ended
    summary = recorder.stop()
    complete = run.code == 0 and not died
    drive, bag = run.drives[0], recorder.bag
    found = check(bag, run.motion, drive, run.limits[drive], complete)
    try:
        card = Card.load(bag)
        told = {
            'complete': complete,
            'ended': 'done' if complete else reason,
            'fitted': list(run.notes),
            'check': {
                name: None if value is None else round(value, 4)
                for name, value in found.figures.items()
            },
            'amiss': list(found.amiss),
        }
        replace(card, drives=run.drives, other={**card.other, **told}).save(bag)
    except InputError as error:
        print(f'the card could not be written: {error}', file=out)
    for line in summary:
        print(line, file=out)
    print(f'\n{check_table(found.rows)}\n', file=out)
    if report is not None:
        content = {
            'bag': str(bag),
            'complete': complete,
            'ended': reason,
            'figures': found.figures,
            'rows': [asdict(row) for row in found.rows],
        }
        text = json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False)
        write_whole(report, f'{text}\n')
    if not complete:
        print(f'{bag} is kept, incomplete: {reason}', file=out)
        return 1
    if run.repetition:
        print(run.repetition, file=out)
    print(
        f'{bag}\nnext: ros2 run power_lab diagnose {bag} --model base.yaml '
        f'--drives {" ".join(run.drives)}',
        file=out,
    )
    return 0 if found.usable else 1
