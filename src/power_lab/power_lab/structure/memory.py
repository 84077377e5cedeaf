"""States that remember the motion: lags, rest, play; their sources go into files of effects."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def lagged(values: Floats, rate: float, seconds: float) -> Floats:
    """First-order lag of values [T] of one stretch, from zero on: a cold start."""
    from scipy.signal import lfilter

    keep = np.exp(-1.0 / (rate * seconds))
    return np.asarray(lfilter([1.0 - keep], [1.0, -keep], values))


def after_rest(
    velocity: Floats, rate: float, standstill: float, seconds: float, travel: float
) -> Floats:
    """
    State of rest, 0 in motion to 1 once the joint has stood [T].

    It grows within 0.3 s of rest, and fades over seconds of motion, or over rad of travel where
    seconds are 0. All steps are composed by doubling, so that no loop runs over the samples.
    """
    speed = np.abs(velocity)
    rests = speed < standstill
    fading = 1.0 / (rate * seconds) if seconds > 0.0 else speed / (rate * travel)
    keep = np.where(rests, np.exp(-1.0 / (0.3 * rate)), np.exp(-fading))
    added = np.where(rests, 1.0 - keep, 0.0)
    step = 1
    while step < len(velocity):
        added[step:] = added[step:] + keep[step:] * added[:-step]
        keep[step:] = keep[step:] * keep[:-step]
        step *= 2
    return added


def play(values: Floats, width: float) -> Floats:
    """
    Place within a play, −1 to 1 [T]: it follows the values and sticks where they turn round.

    All clamps of the play are composed by doubling, so that no loop runs over the samples.
    """
    half = 0.5 * width
    low, high = values - half, values + half
    low[0] = high[0] = values[0]
    step = 1
    while step < len(values):
        before_low, before_high = low[:-step].copy(), high[:-step].copy()
        low[step:], high[step:] = (
            np.clip(before_low, low[step:], high[step:]),
            np.clip(before_high, low[step:], high[step:]),
        )
        step *= 2
    return (values - low) / half


def by_stretch(stretches: list[slice], values: Floats, state, *given: float) -> Floats:  # type: ignore[no-untyped-def]
    """State of values [T], begun anew in each stretch without gaps."""
    out = np.zeros_like(values)
    for part in stretches:
        out[part] = state(values[part], *given)
    return out
