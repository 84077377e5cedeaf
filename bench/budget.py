"""Budgets against true plants: shares of rows whose 90 % interval holds what the circuit knows.

    python bench/budget.py [--count N] [--held-out] [--json FILE]

Each recording is judged with a model of every effect that the plant has, and with one that the
budget chooses by itself.
"""

import argparse
import json
from collections import defaultdict
from collections.abc import Iterator
from itertools import product
from pathlib import Path

import numpy as np
from power_estimator.judge.judge import Judge
from power_estimator.judge.recordings import Loaded
from power_lab.budget.accounts import Accounts
from power_lab.budget.choice import chosen_effects
from power_lab.budget.tally import Tally, interval
from power_lab.session import Session
from power_recordings.alignment.filters import windowed_sinc
from truths import FAMILIES, Case, record
from truths.recorded import START_NS, Recorded
from truths.steps import PARTS
from wattwalk_core.arrays import Bools, Floats

_FIRST = 9  # parts at the shaft, which the torque of a motor has in it
_WITHIN = {'copper_loss': ('winding_heating', 'saturation')}  # where the model has no such part


def cases(count: int, held_out: bool, seconds: float, first: int) -> Iterator[Case]:
    """Yield cases of three drives and `seconds` each, `count` of each family and motion.

    held_out: of families held out from development, else of the others. first: first seed.
    """
    for name, family in FAMILIES.items():
        if family.developed is not held_out:
            for motion, seed in product(family.motions, range(count)):
                yield Case(name, motion, seconds, 3, first + seed)


Row = tuple[str, str, float, float, float, float]  # part, phase, truth, estimate, interval


def rows_of(found: Recorded, accounts: Accounts) -> list[Row]:
    """Return rows (part, phase, truth, estimate, low, high), in W, of all drives together."""
    rows, (tallies,) = accounts.tallies()
    time = accounts.prepared.time - START_NS * 1e-9
    middles = (np.arange(len(found.parts)) + 0.5) / 50.0
    taps = windowed_sinc(np.arange(-10, 11) / 50.0, 12.5, 0.2, 4.9)
    out: list[Row] = []
    for drive, name in enumerate(rows.names):
        smooth = {
            part: np.interp(time, middles, np.convolve(values, taps / taps.sum(), 'same'))
            for part, values in zip(PARTS, found.parts[:, drive].T.astype(float), strict=True)
        }
        truth = _by_part(smooth, rows.parts, bool(found.plant.drives[drive].torque_at_motor))
        out += _compared(tallies[name], truth, {k: v[:, drive] for k, v in rows.masks.items()})
    return out


def _by_part(
    smooth: dict[str, Floats], parts: tuple[str, ...], at_motor: bool
) -> dict[str, Floats]:
    left = dict(smooth)
    shaft = left.pop('shaft')
    if at_motor:
        shaft = shaft + sum(left.pop(name) for name in PARTS[1:_FIRST])
    truth = {'shaft': np.maximum(shaft, 0.0), 'regeneration': np.minimum(shaft, 0.0)}
    for name in parts:
        if name in left:
            truth[name] = left.pop(name)
    for name, others in _WITHIN.items():
        for other in others:
            if name in truth and other in left:
                truth[name] = truth[name] + left.pop(other)
    return truth


def _compared(tally: Tally, truth: dict[str, Floats], masks: dict[str, Bools]) -> list[Row]:
    out: list[Row] = []
    means, limits = tally.means, interval(tally.means)
    for place, (phase, mask) in enumerate(masks.items()):
        if mask.sum() < 50:
            continue
        for part, values in truth.items():
            if part in tally.rows:
                row = tally.rows.index(part)
                ends = limits[place, row].tolist()
                out.append(
                    (part, phase, float(values[mask].mean()), float(means[0, place, row]), *ends)
                )
    return out


def main() -> None:
    """Judge all families and print shares by part."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n\n')[0])
    parser.add_argument('--count', type=int, default=2, help='recordings of a family and motion')
    parser.add_argument('--held-out', action='store_true', help='families held out alone')
    parser.add_argument('--seconds', type=float, default=90.0)
    parser.add_argument('--json', type=Path)
    options = parser.parse_args()
    results = {how: defaultdict[str, list[Row]](list) for how in ('known', 'chosen')}
    for case in cases(options.count, options.held_out, options.seconds, 9000):
        found = record(case)
        judge = Judge(Loaded.of(found.data))
        for how, rows in results.items():
            try:
                effects = found.known if how == 'known' else chosen_effects(judge)
                model = Session(judge).fit(list(effects)).effects
                rows[f'{case.family} {case.motion}'] += rows_of(found, Accounts(judge, model))
            except Exception as error:
                print(case.key, how, type(error).__name__, error)
    for how, found_rows in results.items():
        _print(how, found_rows)
    if options.json:
        options.json.write_text(json.dumps(results))


def _print(how: str, cases: dict[str, list[Row]]) -> None:
    def share(rows: list[Row]) -> str:
        inside = np.mean(
            [low - 0.01 <= truth <= high + 0.01 for _, _, truth, _, low, high in rows]
        )
        width = np.median([high - low for *_, low, high in rows])
        error = np.median([abs(truth - found) for _, _, truth, found, _, _ in rows])
        sizes = f'median width {width:6.2f} W, error {error:5.2f} W'
        return f'{inside:6.1%} of {len(rows):5d} rows; {sizes}'

    every = [row for rows in cases.values() for row in rows]
    print(f'{how}: {share(every)}')
    print('   all phase:', share([row for row in every if row[1] == 'all']))
    for case, rows in cases.items():
        print(f'   {case:24s} {share(rows)}')
    for part in dict.fromkeys(row[0] for row in every):
        print(f'   {part:24s} {share([row for row in every if row[0] == part])}')


if __name__ == '__main__':
    main()
