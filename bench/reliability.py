"""Reliability of the lab: of what it says at a probability, the share that is true.

    python bench/reliability.py [--judge judgements:diagnosed] [--families …] [--count 60]
        [--seconds S] [--drives D] [--nulls] [--sources plants robot logs blind] [--out FILE.jsonl]

Recordings come from families of true plants (bench/truths), from the shipped robot and from real
logs with power of a hidden effect added, or an effect left out of the model. A judge is any
function of bench/judgements.py's interface. Results are appended to FILE; what the same
judge has judged is not run again.
"""

import argparse
import hashlib
import json
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import numpy as np
from drive_logs import log_questions
from lab_scenarios import blind_questions
from power_recordings.alignment.dataset import AlignedDataset
from reliability_figures import tables
from reliability_questions import (
    Question,
    plant_questions,
    robot_questions,
)
from rich.console import Console
from rich.progress import track
from threadpoolctl import threadpool_limits
from truths import FAMILIES
from wattwalk_core.engine.options import Workplace, add_workplace
from wattwalk_core.engine.task_engine import TaskEngine

HERE = Path(__file__).resolve().parent
SOURCES = ('plants', 'robot', 'logs', 'blind')


@dataclass(frozen=True)
class Examination:
    """A question and who is asked."""

    question: Question
    judge: str


def answer(asked: Examination) -> dict[str, Any]:
    """Make the recording, ask the judge and write down what it said and what is true."""
    row = {'key': asked.question.key, **asked.question.about}
    try:
        sealed = asked.question.seal()
        row |= {
            'known': list(sealed.known),
            'missing': sorted(sealed.missing),
            'complete': sealed.complete,
            'impossible': sorted(sealed.impossible),
            'coefficients': {name: dict(own) for name, own in sealed.coefficients.items()},
            'watts': dict(sealed.watts),
            'rate': sealed.data.rate,
            'rms_w': _rms(sealed.data),
        }
        with threadpool_limits(limits=1):
            start = time.monotonic()
            said = resolve_name(asked.judge)(sealed.data, sealed.known)
            row['seconds_taken'] = round(time.monotonic() - start, 1)
        row['statements'] = [[one.effect, one.probability] for one in said.statements]
        row['intervals'] = [
            [one.drive, one.coefficient, one.level, one.low, one.high] for one in said.intervals
        ]
        row['words'] = said.words
    except Exception as error:  # one broken recording must not end the benchmark
        row['error'] = f'{type(error).__name__}: {error}'
    return row


def _rms(data: AlignedDataset) -> float:
    """W rms of the metered power about its mean, over all meters."""
    power = data.power if data.measured_drives() else data.supply[:, None]
    return float(np.sqrt(np.nanmean(np.square(power - np.nanmean(power, axis=0)))))


def version(judge: str) -> str:
    """Hash of the sources that decide, and of the truths."""
    digest = hashlib.sha256(judge.encode())
    module = import_module(judge.partition(':')[0])
    folders = [HERE / 'truths', HERE.parent / 'src' / 'power_estimator']
    folders += [HERE.parent / 'src' / 'power_lab', HERE.parent / 'src' / 'sim_bridge']
    files = [path for folder in folders for path in sorted(folder.rglob('*.py'))]
    for path in [*files, Path(str(module.__file__))]:
        if 'test' not in path.parts:
            digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


def questions(options: argparse.Namespace) -> list[Question]:
    """Questions that the options ask for, in random order."""
    every: list[Question] = []
    if 'plants' in options.sources:
        every += plant_questions(
            options.families,
            options.count,
            seed=options.seed,
            seconds=options.seconds,
            drives=options.drives,
            nulls=options.nulls,
        )
    if 'robot' in options.sources:
        every += robot_questions(options.count, seed=options.seed, nulls=options.nulls)
    if 'blind' in options.sources:
        every += blind_questions(options.seed)
    if 'logs' in options.sources:
        asked, skipped = log_questions()
        every += asked
        for reason in skipped:
            print(f'skipped: {reason}', file=sys.stderr)
    order = np.random.default_rng(options.seed).permutation(len(every))
    return [every[place] for place in order]


def main(arguments: Sequence[str] | None = None) -> int:
    """Ask what is not in the file yet, then print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add('--judge', default='judgements:diagnosed', metavar='MODULE:FUNCTION')
    add('--sources', nargs='+', choices=SOURCES, default=['plants'])
    add('--families', nargs='+', choices=list(FAMILIES), default=list(FAMILIES))
    add('--count', type=int, default=60, help='recordings of each family')
    add('--seconds', type=float, help='length of all of them, instead of 20 to 600 s')
    add('--drives', type=int, help='of all of them, instead of 1, 3 and 12')
    add('--nulls', action='store_true', help='hide nothing')
    add('--seed', type=int, default=0)
    add('--limit', type=int, default=0, help='at most so many, a fair sample')
    add_workplace(parser, 'recordings')
    add('--out', type=Path, default=Path('runs/reliability.jsonl'))
    options = parser.parse_args(arguments)
    os.nice(10)
    todo = questions(options)
    todo = todo[: options.limit] if options.limit else todo
    options.out.parent.mkdir(parents=True, exist_ok=True)
    judged_by = version(options.judge)
    wanted = {question.key for question in todo}
    rows = [row for row in _known(options.out, judged_by) if row['key'] in wanted]
    done = {row['key'] for row in rows}
    asked = [Examination(question, options.judge) for question in todo if question.key not in done]
    with TaskEngine(Workplace.of(options)) as engine, options.out.open('a') as file:
        answers = engine.completed(answer, asked, ('power_lab', 'power_estimator', 'reliability'))
        for _, row in track(answers, 'judging', total=len(asked)):
            rows.append(row | {'judge': judged_by})
            file.write(json.dumps(rows[-1]) + '\n')
            file.flush()
    console = Console(width=150)
    for table in tables(rows):
        console.print(table)
    broken = [row for row in rows if 'error' in row]
    print(f'{len(rows)} recordings, {len(broken)} of them not judged')
    for row in broken[:5]:
        print(f'{row["key"]}: {row["error"]}', file=sys.stderr)
    return 0


def _known(path: Path, judged_by: str) -> list[dict[str, Any]]:
    if not path.exists():
        return []
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    return [row for row in rows if row.get('judge') == judged_by and 'error' not in row]


if __name__ == '__main__':
    from reliability import main as named  # workers import `answer` by the name of its module

    raise SystemExit(named())
