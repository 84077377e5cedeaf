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
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import numpy as np
from drive_logs import log_questions, metered, rms
from judgements import OR
from lab_scenarios import blind_questions
from reliability_questions import Question, plant_questions, robot_questions
from rich.console import Console
from rich.progress import track
from rich.table import Table
from scipy.stats import binomtest
from threadpoolctl import threadpool_limits
from truths import FAMILIES
from wattwalk_core.engine.options import Workplace, add_workplace
from wattwalk_core.engine.task_engine import TaskEngine

Row = dict[str, Any]
BINS = ((0.5, 0.8), (0.8, 0.95), (0.95, 1.0000001))
FLOOR = 0.05
"""Share of the rms power from which a hidden effect counts as large enough to be found."""
COLUMNS = (('developed on', True), ('not developed on', False))


def share(hits: int, count: int) -> str:
    """Write a share with its number and exact interval of 95 %: `0.94 [0.91, 0.96] of 400`."""
    if not count:
        return '–'
    low, high = binomtest(hits, count).proportion_ci()
    return f'{hits / count:.2f} [{low:.2f}, {high:.2f}] of {count}'


def said(rows: Iterable[Row]) -> Iterator[tuple[Row, str, float, bool]]:
    """Yield statements whose truth is known: row, effect, probability and whether it is true."""
    for row in rows:
        for effect, probability in row.get('statements', ()):
            one_of = set(effect.split(OR))
            true = not one_of.isdisjoint(row['missing'])
            if true or row['complete'] or one_of <= set(row['impossible']):
                yield row, effect, probability, true


def covered(rows: Iterable[Row]) -> Iterator[tuple[Row, str, float, bool]]:
    """Yield intervals whose coefficient is known: row, coefficient, level and whether it holds."""
    for row in rows:
        for drive, name, level, low, high in row.get('intervals', ()):
            truth = row['coefficients'].get(drive, {}).get(name)
            if truth is not None:
                yield row, name, level, low <= truth <= high


def _cells(judged: Iterable[tuple[Row, bool]]) -> list[str]:
    """Write the share that is true, for the families of each of COLUMNS."""
    found = list(judged)
    own = ([true for row, true in found if row['developed'] == at] for _, at in COLUMNS)
    return [share(sum(part), len(part)) for part in own]


def reliability(rows: Sequence[Row]) -> Table:
    """Return a table of the share of true statements, by their stated probability."""
    table = Table('said', *(name for name, _ in COLUMNS), title='true, of what was said')
    statements = list(said(rows))
    for low, high in BINS:
        cells = _cells((row, true) for row, _, chance, true in statements if low <= chance < high)
        table.add_row(f'{low:.0%} to {min(high, 1):.0%}', *cells)
    return table


def coverage(rows: Sequence[Row]) -> Table:
    """Return a table of the share of intervals that hold the truth, by coefficient and level."""
    table = Table('coefficient', 'level', *(name for name, _ in COLUMNS), title='intervals')
    intervals = list(covered(rows))
    for name in sorted({name for _, name, _, _ in intervals}):
        for level in sorted({level for _, other, level, _ in intervals if other == name}):
            cells = _cells(
                (row, holds) for row, *which, holds in intervals if which == [name, level]
            )
            table.add_row(name, f'{level:.0%}', *cells)
    return table


def by(rows: Sequence[Row], title: str, of: Callable[[Row], object]) -> Table:
    """Return a table by a property of rows: errors at ≥ 95 %, coverage, detections, nulls.

    of: returns the property's value of a row; title: its name.
    """
    columns = ('wrong at ≥ 95 %', '95 % intervals hold', 'found at ≥ 95 %', 'nulls left alone')
    table = Table(title, 'recordings', *columns, title=f'by {title}')
    for value in sorted({of(row) for row in rows}, key=lambda it: (isinstance(it, str), it)):
        own = [row for row in rows if of(row) == value]
        certain = [true for _, _, p, true in said(own) if p >= 0.95]
        holds = [inside for _, _, level, inside in covered(own) if level == 0.95]
        found, nulls = list(_found(own)), list(_left_alone(own))
        table.add_row(
            str(value),
            str(len(own)),
            share(len(certain) - sum(certain), len(certain)),
            share(sum(holds), len(holds)),
            share(sum(found), len(found)),
            share(sum(nulls), len(nulls)),
        )
    return table


MEASUREMENT = ('torque_scale', 'power_gain', 'current_offset', 'torque_bias')


def measurement(rows: Sequence[Row]) -> Table:
    """Return a table of how often measurement errors are named, where present and where not."""
    columns = ('named at ≥ 95 % where it is off', 'at ≥ 50 %', 'named where it is not')
    table = Table('error', *columns, title='errors of the measurement')
    for name in MEASUREMENT:
        off, fine = [], []
        for row in rows:
            said_at = max((p for effect, p in row['statements'] if effect == name), default=0.0)
            if row['complete']:
                (off if name in row['missing'] else fine).append(said_at)
        cells = [share(sum(p >= least for p in off), len(off)) for least in (0.95, 0.5)]
        table.add_row(name, *cells, share(sum(p >= 0.95 for p in fine), len(fine)))
    return table


def beside_hidden(rows: Sequence[Row]) -> Table:
    """Return a table of effects named in logs with hidden power, but not in the log as it is."""
    title = 'names in logs that the log as it is does not have'
    table = Table('log', 'of what was hidden', 'of anything else', title=title)
    as_it_is = {
        row['family']: dict(row['statements'])
        for row in rows
        if row['family'].startswith('log ') and not row['hidden']
    }
    for family, stated in sorted(as_it_is.items()):
        new = [
            effect in row['missing']
            for row in rows
            if row['family'] == family and row['hidden']
            for effect, probability in row['statements']
            if OR not in effect
            and effect not in MEASUREMENT
            and probability >= 0.95 > stated.get(effect, 0.0)
        ]
        table.add_row(family, str(sum(new)), str(len(new) - sum(new)))
    return table


def _found(rows: Iterable[Row]) -> Iterator[bool]:
    """Yield for each hidden effect that is large enough whether it, or its family, was named."""
    for row in rows:
        stated = dict(row['statements'])
        for effect, watts in row['watts'].items():
            any_of = set(effect.split('|'))
            large = watts >= 0.999 * FLOOR * row['rms_w'] or effect == row.get('left_out')
            if large and any_of & set(row['missing']):
                yield sum(stated.get(name, 0.0) for name in any_of) >= 0.95


def detections(rows: Sequence[Row]) -> Table:
    """Return a table of plants' hidden effects that are found, by what known effects leave."""
    table = Table('known effects leave', 'found at ≥ 95 %', title='hidden effects, of the power')
    for least in (FLOOR, 0.02, 0.0):
        found = [
            dict(row['statements']).get(effect, 0.0) >= 0.95
            for row in rows
            for effect, watts in row.get('apart', {}).items()
            if effect in row['missing'] and watts >= least * row['rms_w']
        ]
        table.add_row(f'{least:.0%} or more', share(sum(found), len(found)))
    return table


def _left_alone(rows: Iterable[Row]) -> Iterator[bool]:
    """Yield for each recording in which nothing is hidden whether no effect was named."""
    for row in rows:
        if row['complete'] and not row['hidden']:
            names = {effect for effect, probability in row['statements'] if probability >= 0.95}
            yield all(set(name.split(OR)) & set(row['missing']) for name in names)


def tables(rows: Sequence[Row]) -> list[Table]:
    """Return all tables of the benchmark; rows with an error are left out."""
    good = [row for row in rows if 'error' not in row]
    return [
        reliability(good),
        coverage(good),
        measurement(good),
        beside_hidden(good),
        detections(good),
        by(good, 'family', lambda row: row['family']),
        by(good, 'length', lambda row: row['seconds']),
        by(good, 'drives', lambda row: row['drives']),
        by(good, 'rate', lambda row: row['rate']),
        by(good, 'motion', lambda row: row['motion']),
        by(good, 'hidden', lambda row: ' + '.join(row['hidden']) or 'nothing'),
    ]


HERE = Path(__file__).resolve().parent
SOURCES = ('plants', 'robot', 'logs', 'blind')


def answer(question: Question, judge: str) -> dict[str, Any]:
    """Make the recording, ask the judge and return its statements with the truth as a row.

    judge: `module:function`.
    """
    row = {'key': question.key, **question.about}
    try:
        sealed = question.seal()
        row |= {
            'known': list(sealed.known),
            'missing': sorted(sealed.missing),
            'complete': sealed.complete,
            'impossible': sorted(sealed.impossible),
            'coefficients': {name: dict(own) for name, own in sealed.coefficients.items()},
            'watts': dict(sealed.watts),
            'apart': dict(sealed.apart),
            'rate': sealed.data.rate,
            'rms_w': rms(metered(sealed.data)),
        }
        with threadpool_limits(limits=1):
            start = time.monotonic()
            said = resolve_name(judge)(sealed.data, sealed.known, sealed.window)
            row['seconds_taken'] = round(time.monotonic() - start, 1)
        row |= {'statements': list(said.statements.items()), 'intervals': list(said.intervals)}
        row['words'] = said.words
    except Exception as error:  # one broken recording must not end the benchmark
        row['error'] = f'{type(error).__name__}: {error}'
    return row


def version(judge: str) -> str:
    """Return a hash of the sources of judge, lab, simulation and truths."""
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
    """Return the questions that the options select, in random order."""
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
    asked = [question for question in todo if question.key not in done]
    ask = partial(answer, judge=options.judge)
    with TaskEngine(Workplace.of(options)) as engine, options.out.open('a') as file:
        answers = engine.completed(ask, asked, ('power_lab', 'power_estimator', 'reliability'))
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
