"""Live watch on hours of the blind benchmark's circuit: false alarms, and the time to a true one.

    python bench/watch_alarms.py [--hours H] [--legs N] [--allowed RATE] [--out FILE.json]

Each leg has three drives and a model that was fitted to its first recording. It walks ten minutes
at a time, at another pace and payload each time; the first hour is the watch's reference. Quiet
hours follow, then Coulomb friction of one drive grows by half. The circuit is that of
bench/truth_circuit.py, never the lab's own formulas.
"""

import argparse
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from lab_scenarios import BASES
from power_estimator.effects import builtin_catalogue
from power_estimator.effects.fit.design import Active
from power_estimator.effects.model_file.model import EffectModel
from power_estimator.effects.training import fit_model, material
from power_estimator.live.change_watch import ChangeWatch, WatchConfig
from power_recordings.alignment.dataset import AlignedDataset
from rich.console import Console
from rich.progress import track
from truth_circuit import NAMES, Truth, record
from wattwalk_core.arrays import Floats
from wattwalk_core.console import output, print_table

_EFFECTS = BASES['core']
_PIECE = 600.0  # s of a recording
_REFERENCE = 6  # recordings
_AFTER = 3  # recordings with the change
_GROWN = 0.5  # of Coulomb friction
_PACES = (0.8, 1.0)
_PAYLOADS = (1.0, 1.1, 1.2)
_MONTH = 30 * 24.0  # h


def truth_of(leg: int, index: int, grown: Floats) -> Truth:
    """Return the circuit of a leg in recording `index`; grown: added Coulomb friction [3]."""
    random = np.random.default_rng([leg, index, 1903])
    effects: dict[str, Any] = {name: np.ones(3) for name in _EFFECTS}
    effects['coulomb_friction'] = 1.0 + grown
    return Truth(
        effects,
        seconds=_PIECE,
        seed=1000 * leg + index,
        unit=leg,
        pace=float(random.choice(_PACES)),
        payload=float(random.choice(_PAYLOADS)),
    )


def fitted(data: AlignedDataset) -> EffectModel:
    """Return the model with all effects of the circuit, fitted to data."""
    catalogue = builtin_catalogue()
    names = ('shaft', *_EFFECTS)
    actives = [Active.of(catalogue[name]) for name in names]
    return fit_model('core', material(data), actives, catalogue)[0]


def seconds(data: AlignedDataset, model: EffectModel) -> Iterator[tuple[Floats, Floats]]:
    """Yield measured − estimated, W [D], and 1, |ω|, ω², τ², P [D, 5] of each second."""
    estimate = np.asarray(model.predict(data), np.float64)
    rate, speed = round(data.rate), np.asarray(data.velocity, np.float64)
    torque = np.asarray(data.torque, np.float64)
    every = [np.ones_like(speed), np.abs(speed), speed**2, torque**2, estimate]
    count = len(data.time) // rate
    difference = np.asarray(data.power, np.float64) - estimate
    for index in range(count):
        rows = slice(index * rate, (index + 1) * rate)
        means = [np.nanmean(values[rows], axis=0) for values in every]
        yield np.nanmean(difference[rows], axis=0), np.stack(means, axis=1)


def try_leg(leg: int, quiet: int, config: WatchConfig) -> dict[str, Any]:
    """Return false alarms of a leg in `quiet` recordings, and the time to the true alarm."""
    watch = ChangeWatch(NAMES, config)
    model: EffectModel | None = None
    place, alarms, told = 0, [], None
    drive = leg % len(NAMES)
    since = 0
    for index in range(_REFERENCE + quiet + _AFTER):
        changed = index >= _REFERENCE + quiet
        grown = _GROWN * changed * (np.arange(3) == drive)
        data = record(truth_of(leg, index, grown))
        model = model or fitted(data)
        for difference, regressors in seconds(data, model):
            place += 1
            since += changed
            shift = watch.second(place, difference, regressors)
            if shift is None:
                continue
            if not changed:
                alarms.append(shift.sentence)
            elif told is None:
                told = {'s': since, 'drive': shift.drive, 'like': list(shift.like)}
        place += config.block  # recordings do not follow each other without a gap
        if told is not None:
            break
    return {
        'leg': leg,
        'quiet_hours': quiet * _PIECE / 3600.0,
        'false_alarms': alarms,
        'drive': NAMES[drive],
        'told': told,
        'left_out': watch.left_out,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--hours', type=float, default=5.0, help='quiet, of each leg')
    parser.add_argument('--legs', type=int, default=6)
    parser.add_argument('--allowed', type=float, default=30.0, help='false alarms a month')
    parser.add_argument('--out', type=Path, help='JSON')
    options = parser.parse_args()
    config = replace(WatchConfig(reference_minutes=50.0), false_alarms_per_month=options.allowed)
    quiet = round(options.hours * 3600.0 / _PIECE)
    console = Console(stderr=True)
    rows = [
        try_leg(leg, quiet, config) for leg in track(range(options.legs), 'legs', console=console)
    ]
    if options.out is not None:
        options.out.write_text(json.dumps(rows, indent=1))
    hours = sum(row['quiet_hours'] for row in rows)
    false = sum(len(row['false_alarms']) for row in rows)
    right = [row for row in rows if row['told'] and row['told']['drive'] == row['drive']]
    named = [row for row in right if 'coulomb_friction' in row['told']['like']]
    times = sorted(row['told']['s'] for row in right)
    figures = {
        'quiet hours of motion': f'{hours:.1f}',
        'false alarms': f'{false}',
        'false alarms allowed': f'{hours / _MONTH * options.allowed:.2f}',
        'Coulomb friction +50 %: told of the right drive': f'{len(right)} of {len(rows)}',
        'Coulomb friction among the likely causes': f'{len(named)} of {len(right)}',
        'time to the alarm, s of motion': ', '.join(map(str, times)),
    }
    print_table(output(), ('figure', 'value'), list(figures.items()))


if __name__ == '__main__':
    main()
