"""
Blind benchmark of the constants of a diagnosis: each changed alone, on the same recordings.

    python bench/lab_constants.py [--seeds 60 …] [--depth decisions|fits] [--out FILE.jsonl]

Recordings (bench/lab_scenarios.py) are simulated once and kept below runs/. Rows are appended to
FILE, one for each constant, value and recording; what is there is not run again. Recordings come
in random order, each with all constants, so that a part is a fair sample.
"""

import argparse
import copy
import hashlib
import json
import os
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from lab import CATALOGUE, DETECTABLE, judge_version, score, told, unabsorbed
from lab_memory import Memory, everywhere, kept_by, replaced
from lab_scenarios import Scenario, few_circuits, few_simulated, random_order
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.effects.fit.fitter import Fitter, measurement_terms
from power_estimator.effects.fit.settings import FitSettings
from power_estimator.effects.signals.prepared import prepare
from power_lab.diagnose.diagnosis import Diagnoser
from power_lab.diagnose.findings import Diagnosis
from power_recordings.alignment.dataset import AlignedDataset
from rich.progress import track
from threadpoolctl import threadpool_limits

_LAB = 'power_lab.diagnose.'
_FLOORS = 'power_lab.structure.floors'
_FIT = ''
_NEVER = 1e9


@dataclass(frozen=True)
class Constant:
    """One constant with the values that are tried instead of its own; no module: of all fits."""

    module: str
    name: str
    values: tuple[Any, ...]
    decides: str

    @property
    def fits(self) -> bool:
        """It changes every fit, so that nothing can be kept."""
        return self.module == _FIT

    @property
    def own(self) -> Any:
        """Its value in the sources."""
        if self.fits:
            return getattr(FitSettings(), self.name)
        return everywhere(self.module, self.name, None)[0][0].__dict__[self.name]


CONSTANTS = (
    Constant(_LAB + 'diagnosis', 'NAME_FLOOR', (0.05, 0.2), 'W: least that is worth a name'),
    Constant(
        _LAB + 'diagnosis', 'NAME_SHARE_OF_RMS', (0.0, 0.00075, 0.003), 'the same, of rms power'
    ),
    Constant(_FLOORS, '_OF_NOISE', (0.0, 0.25, 1.0), 'the same, of the meter noise'),
    Constant(_LAB + 'diagnosis', 'STRUCTURE_FLOOR', (0.075, 0.3), 'W: least that is a structure'),
    Constant(
        _LAB + 'diagnosis', 'STRUCTURE_SHARE_OF_RMS', (0.0, 0.002, 0.008), 'the same, of rms power'
    ),
    Constant(
        _LAB + 'diagnosis', '_MOST_SAMPLED', (1.0, 1.5, 6.0), 'how far sampling may raise that'
    ),
    Constant(_FLOORS, '_ALONE', (1.0, 4.0, _NEVER), 'times a floor, on one drive alone'),
    Constant(_FLOORS, '_SHARED', (0.0, 0.25, 1.0), 'times a floor on a second drive, further'),
    Constant(_FLOORS, '_BY_FAR', (2.0, 8.0, _NEVER), 'the same on one drive alone'),
    Constant(
        _LAB + 'diagnosis', 'NEXT_SHARE', (0.0, 0.01, 0.04, 0.1), 'of the others: a further effect'
    ),
    Constant(_LAB + 'diagnosis', 'TO_THE_NOISE', (0.45, 0.8, _NEVER), 'of the rest: the same'),
    Constant(_LAB + 'beside', 'BESIDE_SHARE', (0.0, 0.075, 0.3), 'of free shapes: a name beside'),
    Constant(_LAB + 'beside', 'MOST_SHAPES', (0, 1, 6), 'free shapes at most'),
    Constant(_LAB + 'free_shapes', '_LEAST', (0.15, 0.6), 'of a floor: a drive has the shape'),
    Constant(_LAB + 'diagnosis', 'NAMED_SHARE', (0.4, 0.6, 0.9), 'of what is explainable: a name'),
    Constant(
        _LAB + 'diagnosis', 'NAMED_SHARE_QUIET', (0.0, 0.25, 0.8), 'the same, little left over'
    ),
    Constant(
        _LAB + 'diagnosis', 'EARNED_SHARE', (0.0, 0.2, 0.8), 'of what was left: the last effect'
    ),
    Constant(
        _LAB + 'diagnosis', 'EARNED_BESIDE_STRUCTURE', (0.4, 0.9), 'the same beside structure'
    ),
    Constant(_LAB + 'diagnosis', 'MOST_RIVALS', (1, 6, 99), 'sets at most, of a further effect'),
    Constant(_LAB + 'diagnosis', '_FINALISTS', (3, 12), 'first effects that are fitted'),
    Constant(_LAB + 'diagnosis', '_EXTRAS', (1, 2, 6), 'further effects that are fitted'),
    Constant(_LAB + 'diagnosis', '_SWAPS', (0, 1, 4), 'exchanges that are fitted'),
    Constant(_LAB + 'diagnosis', '_TESTED_SWAPS', (5, 10, 40), 'exchanges on held-out data'),
    Constant(_LAB + 'diagnosis', '_LEAST_FALL', (0.0, 5e-4, 2e-3, _NEVER), 'for another shape'),
    Constant(_LAB + 'diagnosis', '_EVENT', (10.0, 40.0, _NEVER), 'times the median: an event'),
    Constant(_LAB + 'diagnosis', '_EVENT_SHARE', (0.025, 0.1), 'of the blocks: events at most'),
    Constant(
        _LAB + 'diagnosis', '_BESIDE_CONSTANT', (1.0, 4.0), 'times the watts of a constant torque'
    ),
    Constant(_LAB + 'confidence_set', 'SIZE', (0.01, 0.05, 0.2), 'error rate of the set'),
    Constant(_LAB + 'confidence_set', '_BLOCK', (1, 2, 10), 'blocks of its bootstrap'),
    Constant(_LAB + 'confidence_set', '_REPETITIONS', (250, 1000), 'draws of its bootstrap'),
    Constant(_LAB + 'confidence_set', '_ALIKE', (0.0, 5e-4, 2e-3), 'log error: the same model'),
    Constant(_LAB + 'residual_structure', '_ROWS', (3000, 12000), 'samples for the trees'),
    Constant(_LAB + 'residual_structure', '_TREES', (15, 60), 'trees'),
    Constant(_LAB + 'residual_structure', '_LAGS', ((1,), (1, 2, 3, 4, 5, 6)), 's: what is slow'),
    Constant(_FIT, 'folds', (3, 10), 'folds of the cross-validation'),
    Constant(_FIT, 'piece', (5, 20), 'blocks that stay together'),
    Constant(_FIT, 'embargo', (0, 2), 'blocks left out beside them'),
    Constant(_FIT, 'least_mse', (1e-5, 1e-3), 'W²: errors that are alike'),
    Constant(_FIT, 'block_seconds', ((0.5, 0.1), (2.0, 1.0)), 's of a block'),
    Constant(_FIT, 'least_used', (0.25, 0.9), 'of a block: resolved'),
    Constant(_FIT, 'reweightings', (1, 4), 'rounds of robust weights'),
    Constant(_FIT, 'least_noise', (0.01, 0.04), 'W: weight of priors'),
    Constant(_FIT, 'settled', (0.0, 0.05, 0.2), 'of the residual: a step'),
    Constant(_FIT, 'settled_bound', (0.025, 0.1), 'change of a bound'),
)


SOURCES = {'circuit': few_circuits, 'sim': few_simulated}


def recorded(scenario: Scenario, folder: Path) -> AlignedDataset:
    """Return the scenario's recording, simulated once and kept in the folder."""
    path = folder / f'{hashlib.sha256(scenario.key.encode()).hexdigest()[:16]}.npz'
    if not path.exists():
        data = scenario.record()
        arrays = {
            f.name: np.asarray(getattr(data, f.name)) for f in fields(data) if f.name in KEPT
        }
        part = path.with_suffix('.part.npz')
        np.savez(part, **arrays)
        part.rename(path)
    with np.load(path) as kept:
        values = {name: kept[name] for name in KEPT}
    for name in ('names', 'recordings'):
        values[name] = tuple(values[name].tolist())
    return AlignedDataset(**values | {'rate': float(values['rate'])})


KEPT = (
    *('rate', 'names', 'time', 'segment', 'position', 'velocity', 'torque', 'command'),
    *('power', 'voltage', 'current', 'temperature', 'supply', 'recordings', 'recording'),
)


class Trials:
    """All trials of one recording."""

    def __init__(self, scenario: Scenario, data: AlignedDataset) -> None:
        self.scenario = scenario
        self.prepared = prepare(data)
        self.fitter = Fitter(self.prepared)
        self.memory = Memory()
        structure = Structure(tuple(Active.of(CATALOGUE[name]) for name in scenario.known))
        self.structure = structure.plus(*measurement_terms(CATALOGUE, shaft=True))

    def own(self) -> dict[str, Any]:
        """The diagnosis with all constants as they are."""
        with replaced(kept_by(self.memory)):
            diagnoser, diagnosis, used = self._run(copy.copy(self.fitter), self.memory)
            size = unabsorbed(diagnoser, diagnosis, self.scenario.truth)
        return told(diagnosis) | {'cpu_s': used, 'unabsorbed_w': size}

    def changed(self, constant: Constant, value: Any) -> dict[str, Any]:
        """The diagnosis with one constant changed."""
        if constant.fits:
            memory, prepared = Memory(), replace(self.prepared)
            fitter = Fitter(prepared, settings=FitSettings(**{constant.name: value}))
            places = []
        else:
            memory, fitter = self.memory, copy.copy(self.fitter)
            places = everywhere(constant.module, constant.name, value)
        with replaced(places), replaced(kept_by(memory)):
            _, diagnosis, used = self._run(fitter, memory)
        return told(diagnosis) | {'cpu_s': used}

    def _run(self, fitter: Fitter, memory: Memory) -> tuple[Diagnoser, Diagnosis, float]:
        start = memory.clock()
        diagnoser = Diagnoser(fitter, self.structure, CATALOGUE)
        diagnosis = diagnoser.run()
        return diagnoser, diagnosis, round(memory.clock() - start, 2)


def judge(
    scenario: Scenario, folder: Path, depth: str, done: set[str], seed: int
) -> Iterable[dict[str, Any]]:
    """Rows of one recording: with the constants as they are, then each changed."""
    row = {'key': scenario.key, 'group': scenario.group, 'hidden': list(scenario.hidden)}
    row['fault'] = scenario.fault
    wanted = [
        (constant, value)
        for constant in CONSTANTS
        if constant.fits == (depth == 'fits')
        for value in constant.values
        if trial_key(scenario.key, constant.name, value) not in done
    ]
    if not wanted:
        return
    trials = Trials(scenario, recorded(scenario, folder))
    yield scored(row | {'constant': '', 'value': None} | trials.own())
    for place in np.random.default_rng(seed).permutation(len(wanted)):
        constant, value = wanted[place]
        trial = row | {'constant': constant.name, 'value': value}
        try:
            yield scored(trial | trials.changed(constant, value))
        except Exception as error:  # a value may be one that the procedure cannot do with
            failed = {'verdict': 'failed', 'possible': [], 'cpu_s': 0.0}
            yield scored(trial | failed | {'error': f'{type(error).__name__}: {error}'})


def trial_key(scenario: str, constant: str, value: Any) -> str:
    """Identity of a trial in a file of results."""
    return f'{scenario}|{constant}|{json.dumps(value)}'


def scored(row: dict[str, Any]) -> dict[str, Any]:
    """The row with its score, and its identity."""
    trial = trial_key(row['key'], row['constant'], row['value'])
    return row | {'score': 'failed' if 'error' in row else score(row), 'trial': trial}


def summary(rows: Sequence[dict[str, Any]]) -> str:
    """
    The recordings as they are judged, and a table with one row for each constant.

    What a value changes is told by counts against the same recordings with the constant's own.
    """
    own = {row['key']: row for row in rows if not row['constant']}
    trials: dict[tuple[str, str], list[dict[str, Any]]] = defaultdict(list)
    for row in rows:
        if row['constant'] and row['key'] in own:
            trials[row['constant'], json.dumps(row['value'])].append(row)
    told_ = ', '.join(
        f'{what} {count}' for what, count in _counts(list(own.values()), own).items()
    )
    lines = [f'{len(own)} recordings: {told_}', '']
    lines += ['| constant | value | decides | recordings | changed to | CPU |', '|---' * 6 + '|']
    for constant in CONSTANTS:
        found, counts, costs = [], set(), []
        for value in constant.values:
            given = trials.get((constant.name, json.dumps(value)), [])
            if not given:
                continue
            same = [own[row['key']] for row in given]
            counts.add(len(given))
            found.append(f'{_shown(value)}: {_change(same, given, own)}')
            costs.append(sum(r['cpu_s'] for r in given) / max(sum(r['cpu_s'] for r in same), 1e-9))
        if found:
            cost = f'{min(costs):.2f}–{max(costs):.2f}'
            number = '–'.join(map(str, sorted(counts)))
            cells = (f'`{constant.name}`', _shown(constant.own), constant.decides, number)
            lines.append(f'| {" | ".join(cells)} | {"; ".join(found)} | × {cost} |')
    return '\n'.join(lines)


def _shown(value: Any) -> str:
    if isinstance(value, tuple):
        return '(' + ', '.join(f'{part:g}' for part in value) + ')'
    return 'never' if value == _NEVER else f'{value:g}'


def _change(
    before: Sequence[dict[str, Any]],
    after: Sequence[dict[str, Any]],
    own: dict[str, dict[str, Any]],
) -> str:
    """In words: counts that are other, and verdicts that are."""
    other = sum(_verdict(a) != _verdict(b) for a, b in zip(before, after, strict=True))
    if not other:
        return 'nothing'
    counts = zip(_counts(before, own).items(), _counts(after, own).values(), strict=True)
    parts = [f'{what} {old} → {new}' for (what, old), new in counts if old != new]
    return f'{", ".join(parts)} ({other} other)' if parts else f'({other} other)'


def _verdict(row: dict[str, Any]) -> tuple[Any, ...]:
    return row['verdict'], sorted(map(tuple, row['possible']))


def _counts(rows: Sequence[dict[str, Any]], own: dict[str, dict[str, Any]]) -> dict[str, str]:
    """Wrong names, nulls and faults kept quiet, effects found, unmodelled effects told."""
    found = ('named', 'in the set')

    def share(groups: Sequence[str], wanted: Sequence[str], least: float = 0.0) -> str:
        some = [
            row
            for row in rows
            if row['group'] in groups and own[row['key']]['unabsorbed_w'] >= least
        ]
        return f'{sum(row["score"] in wanted for row in some)}/{len(some)}'

    wrong = sum(row['score'] in ('WRONG', 'FALSE ALARM') for row in rows)
    effects = ('effect', 'pair', 'beside')
    return {
        'failed': str(sum(row['score'] == 'failed' for row in rows)),
        'wrong': str(wrong),
        'quiet': share(('null', 'fault'), ('no evidence',)),
        'named': share(effects, ('named',), DETECTABLE),
        'named or in the set': share(effects, found, DETECTABLE),
        'unmodelled told': share(('unmodelled', 'constant'), (*found, 'none of the above')),
    }


def main() -> int:
    """Run what is not in the file yet, then print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add('--seeds', type=int, nargs='+', default=[60])
    add('--seconds', type=float, default=90.0, help='of each recording')
    add('--depth', choices=('decisions', 'fits'), default='decisions')
    add('--judge', nargs='+', help='only print the table of what these versions of the lab did')
    add('--sources', nargs='+', choices=('circuit', 'sim'), default=['circuit', 'sim'])
    add('--limit', type=int, default=0, help='at most so many recordings, a fair sample')
    add('--keep', type=Path, default=Path('runs/lab_constants'))
    add('--out', type=Path, default=Path('runs/lab_constants.jsonl'))
    options = parser.parse_args()
    os.nice(19)
    options.keep.mkdir(parents=True, exist_ok=True)
    kinds = [kind for name, kind in SOURCES.items() if name in options.sources]
    seeds = options.seeds
    todo = random_order([s for n in seeds for kind in kinds for s in kind(n, options.seconds)])
    todo = todo[: options.limit or None]
    judged_by = judge_version(bench=False)
    rows = []
    if options.out.exists():
        rows = [json.loads(line) for line in options.out.read_text().splitlines()]
        rows = [row for row in rows if row['judge'] in (options.judge or [judged_by])]
    done = {row['trial'] for row in rows}
    if not options.judge:
        with threadpool_limits(limits=1), options.out.open('a') as file:
            for place, scenario in enumerate(track(todo, 'judging')):
                for row in judge(scenario, options.keep, options.depth, done, place):
                    rows.append(row | {'judge': judged_by})
                    file.write(json.dumps(rows[-1]) + '\n')
                    file.flush()
    print(summary(rows))
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
