"""Strides by the foot forces, and the mean gait cycle of Figure 6 of the paper."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.anymal import FOOT_NAMES
from wattwalk_core.arrays import Bools, Floats

from policy_training.evaluation.measured_walk import RAW_RATE, MeasuredWalk, columns_of

PHASES: Final = 100
_LOADED, _LIFTED = 40.0, 10.0  # N: a foot touches down above the one and lifts off below the other
_SHORTEST = 0.12  # s of a stride
_LONGEST = 2.5  # s
_IMPACT = 0.05  # s after touch-down
_FAST = 20.0  # Hz, above which content is not the gait's
_TINY = 1e-12


@dataclass(frozen=True)
class Cycle:
    """Mean gait cycle of one leg from touch-down to touch-down, by name of the signal."""

    phase: Floats  # 0..1 [100]
    stance: float  # share of the cycle on the ground
    mean: dict[str, Floats]  # [100]
    low: dict[str, Floats]  # 10 % of the strides lie below [100]
    high: dict[str, Floats]


def find_steps(force: Floats, steady: Bools) -> list[tuple[int, int, int]]:
    """Return the strides of one foot from its force, N [R], wholly in steady walking [R].

    A stride is the indices of touch-down, lift-off and the next touch-down.
    """
    stance = np.empty(len(force), bool)
    standing = bool(force[0] > _LOADED)
    for index, value in enumerate(force.tolist()):
        standing = value > _LIFTED if standing else value > _LOADED
        stance[index] = standing
    change = np.diff(stance.astype(np.int8))
    downs, ups = np.flatnonzero(change == 1) + 1, np.flatnonzero(change == -1) + 1
    strides = []
    for start, stop in pairwise(downs.tolist()):
        lifted = ups[(ups > start) & (ups < stop)]
        length = (stop - start) / RAW_RATE
        if steady[start:stop].all() and len(lifted) == 1 and _SHORTEST <= length <= _LONGEST:
            strides.append((start, int(lifted[0]), stop))
    return strides


def gait_of(walk: MeasuredWalk) -> dict[str, float]:
    """Return times and impacts of all feet in a walk's steady part; NaN where no stride was found.

    impact_n: mean of the peak force within 50 ms of touch-down; impact_rate_db: see `loudness`.
    """
    strides = [
        (leg, *stride)
        for leg, force in enumerate(walk.foot_force.T)
        for stride in find_steps(force, walk.raw_steady)
    ]
    events = np.array([times for _, *times in strides], np.float64).reshape(-1, 3) / RAW_RATE
    down, up, then = events.mean(axis=0).tolist() if strides else [float('nan')] * 3
    peak = round(_IMPACT * RAW_RATE)
    impacts = [walk.foot_force[down : down + peak, leg].max() for leg, down, _, _ in strides]
    return {
        'stride_s': then - down,
        'swing_s': then - up,
        'stance_s': up - down,
        'impact_n': float(np.mean(impacts or [np.nan])),
        'impact_rate_db': loudness(walk),
        'strides': len(strides),
    }


def loudness(walk: MeasuredWalk) -> float:
    """Return a proxy of Figure 7's sound level, dB, from the rate of the foot forces.

    Ten times the logarithm of the mean square of the forces' rate, over (1 kN/s)²; what radiates
    sound is the change of force at impact. NaN without steady walking.
    """
    if not walk.raw_steady.any():
        return float('nan')
    rate = np.gradient(walk.foot_force, 1.0 / RAW_RATE, axis=0)[walk.raw_steady]
    return float(10.0 * np.log10(np.square(rate / 1e3).sum(axis=1).mean() + _TINY))


def cycle_of(walk: MeasuredWalk) -> Cycle | None:
    """Return the mean cycle of the leg LF, for the drive LF_KFE; None below 3 strides."""
    foot = FOOT_NAMES.index('LF_FOOT')
    strides = find_steps(walk.foot_force[:, foot], walk.raw_steady)
    if len(strides) < 3:
        return None
    raw, column = walk.raw, walk.raw.names.index('LF_KFE')
    signals: dict[str, NDArray[np.floating]] = {
        'torque': raw.torque[:, column],
        'velocity': raw.velocity[:, column],
        'position_error': raw.position_error[:, column],
        'power': raw.power[:, column],
        'foot_force': walk.foot_force[:, foot],
    }
    phase = np.linspace(0.0, 1.0, PHASES)
    rows = {
        name: [
            np.interp(phase, np.linspace(0.0, 1.0, stop - start + 1), values[start : stop + 1])
            for start, _, stop in strides
        ]
        for name, values in signals.items()
    }
    mean = {name: np.mean(cycles, axis=0) for name, cycles in rows.items()}
    low = {name: np.quantile(cycles, 0.1, axis=0) for name, cycles in rows.items()}
    high = {name: np.quantile(cycles, 0.9, axis=0) for name, cycles in rows.items()}
    stance = np.mean([(up - down) / (then - down) for down, up, then in strides])
    return Cycle(phase, float(stance), mean, low, high)


def fast_share(walk: MeasuredWalk) -> float:
    """Return the share of torque variance above 20 Hz of the KFEs; NaN if not steady."""
    rows = walk.raw.torque[walk.raw_steady][:, columns_of(walk.raw, 'KFE')].astype(np.float64)
    if len(rows) < round(RAW_RATE):
        return float('nan')
    spectrum = np.abs(np.fft.rfft(rows - rows.mean(axis=0), axis=0)) ** 2
    frequency = np.fft.rfftfreq(len(rows), 1.0 / RAW_RATE)
    return float(spectrum[frequency > _FAST].sum() / spectrum.sum())
