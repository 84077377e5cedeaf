"""Levers of budgets against true plants that were changed so, at the same motion of the joints.

python bench/budget_levers.py [--count N] [--held-out]
"""

import argparse
from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from budget import cases
from power_estimator.judge.judge import Judge
from power_estimator.judge.recordings import Loaded
from power_lab.session import Session
from scipy.ndimage import gaussian_filter1d
from truths import FAMILIES, Case, record
from truths.families import TruePlant
from truths.motions import RATE
from truths.parameters import Drive
from truths.recorded import Simulated, simulate
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError

_UP, _DOWN = 1.1, 0.9
_CORRECTIONS = 6
_SMOOTH = 0.02  # s, slower than the torque loops


def _times(factor: float, *names: str) -> Callable[[Drive], Drive]:
    return lambda d: replace(d, **{name: getattr(d, name) * factor for name in names})


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
    'winding_resistance': (_DOWN, _times(_DOWN, 'resistance')),
    'friction': (
        _DOWN,
        _times(_DOWN, 'coulomb', 'stribeck', 'viscous', 'load_friction', 'rub'),
    ),
    'idle': (_DOWN, _times(_DOWN, 'idle')),
    'supply_voltage': (_UP, lambda d: d),
    'payload': (_DOWN, lambda d: d),
}


def run(
    case: Case, plant: TruePlant, load: float = 1.0, like: Simulated | None = None
) -> Simulated:
    """Simulate a case on a plant, with the joints' torque of the run `like` times `load`.

    With springs, commanded torque is corrected in 6 iterations, since the joint torque differs
    from it by a share of the friction.
    """
    made = simulate(case, plant, load)
    if like is None or not any(drive.stiffness > 0.0 for drive in plant.drives):
        return made
    knots = np.arange(int(case.seconds * RATE) + 3) / RATE - 1.0 / RATE
    correction: Floats | float = 0.0
    for _ in range(_CORRECTIONS):
        off = load * like.joints[2] - made.joints[2]
        short = np.stack([np.interp(knots, made.joint_time, own) for own in off], axis=1)
        correction = correction + gaussian_filter1d(short, _SMOOTH * RATE, axis=0)
        made = simulate(case, plant, load, correction)
    return made


def mean_w(made: Simulated) -> float:
    """Return the mean of the sum of all drives' powers, W."""
    return float(made.power.mean(axis=0).sum())


def changed(plant: TruePlant, lever: str) -> TruePlant:
    """Return the plant changed as CHANGES has it for a lever."""
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
    parser.add_argument('--families', nargs='+', choices=sorted(FAMILIES))
    parser.add_argument('--held-out', action='store_true', help='families held out alone')
    options = parser.parse_args()
    found: dict[str, list[bool]] = defaultdict(list)
    for case in cases(options.count, options.held_out, 60.0, 9100):
        if case.family not in (options.families or FAMILIES):
            continue
        made = record(case)
        lab = Session(Judge(Loaded.of(made.data))).fit(list(made.known))
        before = run(case, made.plant)
        for lever, (factor, _) in CHANGES.items():
            try:
                (told,) = lab.budget({lever: factor}).levers
            except InputError:
                continue
            load = factor if lever == 'payload' else 1.0
            after = run(case, changed(made.plant, lever), load, before)
            truth = mean_w(after) - mean_w(before)
            low, high = told.interval
            within = low - 0.01 <= truth <= high + 0.01
            found[lever].append(within)
            print(
                f'{case.family:9s} {case.motion:7s} {lever:19s} truth {truth:+8.3f} W, '
                f'found {told.mean_w:+8.3f} ({low:+.3f} … {high:+.3f}) '
                f'{"" if within else "outside"}'
            )
    for lever, held in found.items():
        print(f'{lever:20s} {sum(held)} of {len(held)} within')


if __name__ == '__main__':
    main()
