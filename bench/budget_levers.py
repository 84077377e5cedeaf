"""Levers of budgets against true plants that were changed so, at the same motion of the joints.

python bench/budget_levers.py [--count N] [--held-out]
"""

import argparse
from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import replace
from unittest.mock import patch

from power_estimator.judge.judge import Judge
from power_estimator.judge.recordings import Loaded
from power_lab.session import Session
from truths import FAMILIES, MOTIONS, Case, record
from truths.families import TruePlant
from truths.parameters import Drive
from truths.recorded import simulate
from wattwalk_core.errors import InputError

_UP, _DOWN = 1.1, 0.9
CHANGES: Mapping[str, tuple[float, Callable[[Drive], Drive]]] = {
    'gear_ratio': (
        _UP,
        lambda d: replace(
            d,
            torque_constant=d.torque_constant * _UP,
            inertia=d.inertia * _UP**2,
            iron=d.iron * _UP**d.iron_exponent,
            pole_pairs=d.pole_pairs * _UP,
        ),
    ),
    'winding_resistance': (_DOWN, lambda d: replace(d, resistance=d.resistance * _DOWN)),
    'friction': (
        _DOWN,
        lambda d: replace(
            d,
            coulomb=d.coulomb * _DOWN,
            stribeck=d.stribeck * _DOWN,
            viscous=d.viscous * _DOWN,
            load_friction=d.load_friction * _DOWN,
            rub=d.rub * _DOWN,
        ),
    ),
    'idle': (_DOWN, lambda d: replace(d, idle=d.idle * _DOWN)),
    'supply_voltage': (_UP, lambda d: d),
    'payload': (_DOWN, lambda d: d),
}


def watts(case: Case, plant: TruePlant, load: float = 1.0) -> float:
    """Mean power of all drives with the joints' torque times a factor, W."""
    motion = MOTIONS[case.motion]

    def loaded(ask: object) -> object:
        position, torque = motion(ask)  # type: ignore[arg-type]
        return position, torque * load

    with patch.dict(MOTIONS, {case.motion: loaded}):
        return float(simulate(case, plant).power.mean(axis=0).sum())


def changed(plant: TruePlant, lever: str) -> TruePlant:
    """The plant with a lever's change."""
    factor, change = CHANGES[lever]
    found = replace(plant, drives=tuple(change(drive) for drive in plant.drives))
    if lever == 'supply_voltage':
        supply = replace(plant.supply, voltage=plant.supply.voltage * factor)
        found = replace(found, supply=supply)
    return found


def main() -> None:
    """Print the share of changes within their intervals, by lever."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n\n')[0])
    parser.add_argument('--count', type=int, default=1, help='recordings of a family and motion')
    parser.add_argument('--held-out', action='store_true', help='families held out alone')
    options = parser.parse_args()
    found: dict[str, list[tuple[bool, float, float]]] = defaultdict(list)
    for name, family in FAMILIES.items():
        if family.developed is options.held_out:
            continue
        for motion in family.motions:
            for seed in range(options.count):
                case = Case(name, motion, 60.0, 3, 9100 + seed)
                made = record(case)
                lab = Session(Judge(Loaded.of(made.data))).fit(list(made.known))
                before = watts(case, made.plant)
                for lever, (factor, _) in CHANGES.items():
                    try:
                        (told,) = lab.budget({lever: factor}).levers
                    except InputError:
                        continue
                    load = factor if lever == 'payload' else 1.0
                    truth = watts(case, changed(made.plant, lever), load) - before
                    low, high = told.interval
                    within = low - 0.01 <= truth <= high + 0.01
                    found[lever].append((within, truth, told.mean_w))
                    print(
                        f'{name:9s} {motion:7s} {lever:19s} truth {truth:+8.3f} W, '
                        f'found {told.mean_w:+8.3f} ({low:+.3f} … {high:+.3f}) '
                        f'{"" if within else "outside"}'
                    )
    for lever, rows in found.items():
        print(f'{lever:20s} {sum(within for within, *_ in rows)} of {len(rows)} within')


if __name__ == '__main__':
    main()
