"""
Blind benchmark of `power_fleet track`: which of many histories change, in what, since when.

    python bench/track.py [--histories N] [--recordings M] [--cache runs/track] [--out FILE.json]
                          [--workers W]

Half of the histories have nothing but weather (temperature, gaits, payloads). In a quarter one
effect of one drive grows by 25 to 60 %, in a quarter a current sensor's gain or offset moves, at
once or slowly. Every history lacks a week; every third has two robots that take turns.
The circuit is that of bench/truth_circuit.py, never the lab's own formulas.
"""

import argparse
import json
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from power_fleet.track.history import histories
from power_fleet.track.search import CertainChange, Search, search
from power_fleet.track.unmodelled import growths
from rich.console import Console
from rich.progress import track
from rich.table import Table
from threadpoolctl import threadpool_limits
from track_histories import CATALOGUE, Plan, history, plan
from wattwalk_core.engine.options import Workplace, add_workplace
from wattwalk_core.engine.task_engine import TaskEngine

NEAR = 5  # recordings that a date may be off by
SCORES = {
    'detected': 'found',
    'right_drive': 'drive',
    'right_effect': 'effect named first',
    'among': 'effect among those named',
    'near': f'date within {NEAR}',
    'whole': f'drive, effect named first, date within {NEAR}',
}


def judge(own: Plan, count: int, cache: Path) -> dict[str, Any]:
    """Run `track` on one history and score it."""
    start = time.process_time()
    fits = history(own, count, cache)
    fitted = time.process_time()
    drives = histories(fits)
    result = search(drives, CATALOGUE)
    row: dict[str, Any] = {
        **own.__dict__,
        'found': [_told(finding, result) for finding in result.findings],
        'grown': [drives[growth.drive].drive for growth in growths(drives)],
        'explained': [
            (result.models[e.drive].history.drive, e.change.hypothesis, e.covariate)
            for e in result.explained
        ],
        'seconds_fits': round(fitted - start, 2),
        'seconds_search': round(time.process_time() - fitted, 2),
    }
    if own.kind != 'quiet':
        row |= _scored(own, result)
    return row


def _told(finding: CertainChange, result: Search) -> dict[str, Any]:
    model, change = result.models[finding.drive], finding.change
    return {
        'drive': model.history.drive,
        'hypothesis': change.hypothesis,
        'course': 'step' if change.profile.step else 'drift',
        'begin': change.profile.end if change.profile.step else change.profile.begin,
        'end': change.profile.end,
        'size': float(f'{change.size:.4g}'),
        'certainty': round(finding.certainty, 4),
        'rivals': [rival.hypothesis for rival in finding.rivals],
    }


def _scored(own: Plan, result: Search) -> dict[str, Any]:
    """Compare the first finding with the plan."""
    if not result.findings:
        return {'detected': False}
    first = result.findings[0]
    model = result.models[first.drive]
    told = _told(first, result)
    named = {first.change.hypothesis, *told['rivals']}
    before = model.levels[0][0]
    labels = model.history.labels
    share = own.size
    if own.kind == 'wear':
        column = labels.index((first.change.hypothesis, 0))
        before = float(model.levels[0][column])
        found = first.change.size / before
    else:
        found = first.change.size
    right = {
        'right_drive': told['drive'] == own.meter,
        'right_effect': first.change.hypothesis == own.effect,
        'near': abs(told['begin'] - own.begin) <= NEAR,
    }
    return {
        'detected': True,
        **right,
        'whole': all(right.values()),
        'among': own.effect in named,
        'date_error': abs(told['begin'] - own.begin),
        'size_error': abs(found / share - 1.0) if first.change.hypothesis == own.effect else None,
        'more': len(result.findings) - 1,
    }


def judge_seed(seed: int, count: int, cache: Path) -> dict[str, Any]:
    """Run `track` on the history of a seed, on one core, and score it."""
    with threadpool_limits(limits=1):
        return judge(plan(seed, count), count, cache)


def main() -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--histories', type=int, default=8)
    parser.add_argument('--recordings', type=int, default=40)
    parser.add_argument('--first', type=int, default=0, help='seed of the first history')
    parser.add_argument('--cache', type=Path, default=Path('runs/track'))
    parser.add_argument('--out', type=Path, default=Path('runs/track/result.json'))
    add_workplace(parser, 'histories')
    options = parser.parse_args()
    console, rows = Console(), []
    seeds = range(options.first, options.first + options.histories)
    judged = partial(judge_seed, count=options.recordings, cache=options.cache)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    with TaskEngine(Workplace.of(options)) as engine:
        found = engine.in_order(judged, seeds, ('power_lab', 'power_estimator', 'track'))
        for row in track(found, 'histories', len(seeds), console=Console(stderr=True)):
            rows.append(row)
            options.out.write_text(json.dumps(rows, indent=1, default=float))
    console.print(table(rows))


def table(rows: list[dict[str, Any]]) -> Table:
    """Scores of all histories."""
    quiet = [row for row in rows if row['kind'] == 'quiet']
    wear = [row for row in rows if row['kind'] == 'wear']
    meter = [row for row in rows if row['kind'] in ('gain', 'offset')]
    out = Table('score', 'of', 'figure', title=f'{len(rows)} histories')

    def add(name: str, hits: int, count: int) -> None:
        out.add_row(name, str(count), f'{hits} ({100 * hits / max(count, 1):.0f} %)')

    add('quiet: any alarm', sum(bool(row['found'] or row['grown']) for row in quiet), len(quiet))
    for name, own in (('wear', wear), ('meter', meter)):
        for key, words in SCORES.items():
            add(f'{name}: {words}', sum(row.get(key, False) for row in own), len(own))
        errors = [row['size_error'] for row in own if row.get('size_error') is not None]
        if errors:
            middle = f'{100 * np.median(errors):.0f} %'
            out.add_row(f'{name}: median error of size', str(len(errors)), middle)
    cost = [row['seconds_search'] for row in rows]
    out.add_row('CPU s of a search', str(len(rows)), f'median {np.median(cost):.1f}')
    return out


if __name__ == '__main__':
    from track import main as named  # workers import `judge_seed` by the name of its module

    named()
