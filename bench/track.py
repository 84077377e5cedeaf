"""Blind benchmark of `power_fleet track`: which of many histories change, in what, since when.

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
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from lab_scenarios import BASES
from power_estimator.effects import builtin_catalogue
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.effects.model_file.model import EffectModel
from power_estimator.judge.judge import Judge
from power_estimator.judge.recordings import Loaded
from power_fleet.track.history import histories
from power_fleet.track.recording_fit import (
    Occasion,
    RecordingFit,
    fit_recording,
    from_bytes,
    to_bytes,
)
from power_fleet.track.search import CertainChange, Search, search
from power_fleet.track.unmodelled import growths
from rich.console import Console
from rich.progress import track
from rich.table import Table
from threadpoolctl import threadpool_limits
from truth_circuit import NAMES, Faults, Truth, record
from wattwalk_core.engine.options import Workplace, add_workplace
from wattwalk_core.engine.task_engine import TaskEngine
from wattwalk_core.files import write_whole

CATALOGUE = builtin_catalogue()
EFFECTS = BASES['core']
WORN = ('coulomb_friction', 'viscous_friction', 'copper_loss', 'idle')
SECONDS = 60.0
_DAY = 86_400.0
_START = 1.7e9  # s since 1970
_WARMTH = {'viscous_friction': -0.012, 'coulomb_friction': -0.004, 'copper_loss': 0.0035}  # 1/K
_KINDS = ('quiet', 'wear', 'quiet', 'gain', 'quiet', 'wear', 'quiet', 'offset')


@dataclass(frozen=True)
class Plan:
    """Sealed change of one drive in a history.

    The robots of a history take turns; begin and end count the recordings of the one that changes.
    """

    seed: int
    kind: str  # quiet, wear, gain or offset
    effect: str = ''
    drive: str = ''
    course: str = ''  # step or ramp
    begin: int = 0  # first recording that differs
    end: int = 0  # first recording with all of the change
    size: float = 0.0  # share of the effect; of the gain: 1; of the offset: A
    robots: int = 1
    robot: int = 0  # the one that changes

    @property
    def meter(self) -> str:
        """Name of the drive that changes in the results, with the robot where there are two."""
        return f'leg_{self.robot} {self.drive}' if self.robots > 1 else self.drive

    def share(self, index: int) -> float:
        """Return the share, 0 to 1, of the change in the recording of an index."""
        if self.kind == 'quiet':
            return 0.0
        if self.course == 'step':
            return float(index >= self.begin)
        return float(np.clip((index - self.begin + 1) / (self.end - self.begin + 1), 0.0, 1.0))


def plan(seed: int, count: int) -> Plan:
    """Draw the sealed plan of a history of so many recordings; every third has two robots."""
    random = np.random.default_rng([seed, 1900])
    kind = _KINDS[seed % len(_KINDS)]
    robots = 2 if seed % 3 == 2 else 1
    count //= robots
    if kind == 'quiet':
        return Plan(seed, kind, robots=robots)
    drive = str(random.choice(NAMES))
    begin = int(random.integers(count // 4, count - count // 3))
    course = str(random.choice(('step', 'ramp')))
    end = begin if course == 'step' else int(random.integers(begin + count // 5, count))
    if kind == 'wear':
        effect, size = WORN[seed // 4 % len(WORN)], float(random.uniform(0.25, 0.6))
    elif kind == 'gain':
        effect, size = 'power_gain', float(random.choice((-1, 1)) * random.uniform(0.03, 0.06))
    else:
        effect, size = 'current_offset', float(random.uniform(0.02, 0.04))
    robot = int(random.integers(robots))
    return Plan(seed, kind, effect, drive, course, begin, end, size, robots, robot)


def circumstances(own: Plan, count: int) -> Iterator[tuple[Occasion, Truth]]:
    """Yield occasion and simulated truth of each of `count` recordings of a history."""
    random = np.random.default_rng([own.seed, 1901])
    phase, days = random.uniform(0, 2 * np.pi), np.cumsum(random.integers(1, 4, count))
    days[random.integers(count) :] += 7  # a week without recordings
    for index in range(count):
        turn, robot = divmod(index, own.robots)
        season = 9.0 * np.sin(2 * np.pi * days[index] / 365.0 + phase)
        temperature = 16.0 + season + random.normal(0, 4.0)
        gait = str(random.choice(('trot', 'slow', 'bench'), p=(0.55, 0.3, 0.15)))
        payload = float(random.choice((0.0, 5.0, 10.0)))
        effects: dict[str, Any] = {
            name: np.full(3, np.exp(_WARMTH.get(name, 0.0) * (temperature - 16.0)))
            for name in EFFECTS
        }
        faults, place = Faults(), [name == own.drive for name in NAMES]
        share = own.share(turn) if robot == own.robot else 0.0
        step = own.size * share * np.array(place, dtype=np.float64)
        if own.kind == 'wear':
            effects[own.effect] = effects[own.effect] * (1.0 + step)
        elif own.kind == 'gain':
            faults = replace(faults, gain=step)
        elif own.kind == 'offset':
            faults = replace(faults, current_offset=step)
        yield (
            Occasion(
                f'day_{days[index]:03d}',
                _START + _DAY * float(days[index]),
                f'leg_{robot}',
                {'temperature': round(temperature + random.normal(0, 1.0), 1), 'payload': payload},
                {'controller': gait},
            ),
            Truth(
                effects,
                'ladder' if gait == 'bench' else 'walk',
                SECONDS,
                seed=own.seed * 1000 + index,
                unit=2 * own.seed + robot,
                faults=faults,
                pace=0.8 if gait == 'slow' else 1.0,
                payload=1.0 + payload / 50.0,
            ),
        )


def model() -> EffectModel:
    """Return the model that is tracked, with all effects of the circuit."""
    names = ('shaft', *EFFECTS)
    return EffectModel('core', Structure(tuple(Active.of(CATALOGUE[name]) for name in names)))


def history(own: Plan, count: int, cache: Path) -> list[RecordingFit]:
    """Return fits of a history's recordings, from the cache folder or by simulation."""
    cache.mkdir(parents=True, exist_ok=True)
    out = []
    for index, (occasion, truth) in enumerate(circumstances(own, count)):
        file = cache / f'{own.seed}_{count}_of_{own.robots}_{index}.fit'
        if not file.exists():
            fit = fit_recording(Judge(Loaded.of(record(truth))), model(), occasion)
            write_whole(file, to_bytes(fit))
        out.append(from_bytes(file.read_bytes()))
    return out


NEAR = 5  # recordings that a date may be off by
SCORES = {
    'detected': 'found',
    'right_drive': 'drive',
    'right_effect': 'effect named first',
    'among': 'effect among those named',
    'near': f'date within {NEAR}',
    'whole': f'drive, effect named first, date within {NEAR}',
}


def judge(seed: int, count: int, cache: Path) -> dict[str, Any]:
    """Run `track` on the history of a seed, on one core; return its scores as a row."""
    own = plan(seed, count)
    with threadpool_limits(limits=1):
        start = time.process_time()
        drives = histories(history(own, count, cache))
        fitted = time.process_time()
        result = search(drives, CATALOGUE)
        grown = [drives[growth.drive].drive for growth in growths(drives)]
        ended = time.process_time()
    row: dict[str, Any] = {
        **own.__dict__,
        'found': [_told(finding, result) for finding in result.findings],
        'grown': grown,
        'explained': [
            (result.models[e.drive].history.drive, e.change.hypothesis, e.covariate)
            for e in result.explained
        ],
        'seconds_fits': round(fitted - start, 2),
        'seconds_search': round(ended - fitted, 2),
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
    found = first.change.size
    if own.kind == 'wear':
        column = model.history.labels.index((first.change.hypothesis, 0))
        found /= float(model.levels[0][column])
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
        'size_error': abs(found / own.size - 1.0) if right['right_effect'] else None,
        'more': len(result.findings) - 1,
    }


def main() -> None:
    """Score `track` on many histories, print the tables and write the results as JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--histories', type=int, default=8)
    parser.add_argument('--recordings', type=int, default=40)
    parser.add_argument('--first', type=int, default=0, help='seed of the first history')
    parser.add_argument('--cache', type=Path, default=Path('runs/track'))
    parser.add_argument('--out', type=Path, default=Path('runs/track/result.json'))
    add_workplace(parser, 'histories')
    options = parser.parse_args()
    console, rows = Console(), []
    seeds = range(options.first, options.first + options.histories)
    judged = partial(judge, count=options.recordings, cache=options.cache)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    with TaskEngine(Workplace.of(options)) as engine:
        found = engine.in_order(judged, seeds, ('power_lab', 'power_estimator', 'track'))
        for row in track(found, 'histories', len(seeds), console=Console(stderr=True)):
            rows.append(row)
            options.out.write_text(json.dumps(rows, indent=1, default=float))
    console.print(table(rows))


def table(rows: list[dict[str, Any]]) -> Table:
    """Return a table of the scores of all histories."""
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
    from track import main as named  # workers import `judge` by the name of its module

    named()
