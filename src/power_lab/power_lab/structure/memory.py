"""States that remember the motion: lags, rest, play; their sources go into files of effects."""

import numpy as np
from wattwalk_core.arrays import Floats


def lagged(values: Floats, before: Floats | None, rate: float, seconds: float) -> Floats:
    """First-order low-pass of values [T] at a rate in Hz; seconds: time constant.

    before: last input and output [2], None to start from zero.
    """
    from scipy.signal import lfilter  # here, as effect files copy the function

    keep = np.exp(-1.0 / (rate * seconds))
    state = [0.0 if before is None else keep * before[1]]
    return np.asarray(lfilter([1.0 - keep], [1.0, -keep], values, zi=state)[0])


def after_rest(
    velocity: Floats,
    before: Floats | None,
    rate: float,
    standstill: float,
    seconds: float,
    travel: float,
) -> Floats:
    """State of rest, 0 in motion to 1 once the joint has stood [T].

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
    return added if before is None else added + keep * before[1]


def play(values: Floats, before: Floats | None, width: float) -> Floats:
    """Position within a backlash, −1 to 1 [T]: it follows the values and sticks at reversals.

    All clamps are composed by doubling, so that no loop runs over the samples.
    """
    half = 0.5 * width
    low, high = values - half, values + half
    start = values[0] if before is None else np.clip(before[0] - half * before[1], low[0], high[0])
    low[0] = high[0] = start
    step = 1
    while step < len(values):
        before_low, before_high = low[:-step].copy(), high[:-step].copy()
        low[step:], high[step:] = (
            np.clip(before_low, low[step:], high[step:]),
            np.clip(before_high, low[step:], high[step:]),
        )
        step *= 2
    return (values - low) / half


def by_stretch(signals, column: int, values: Floats, state, *given: float) -> Floats:  # type: ignore[no-untyped-def]
    """Apply a state such as `play` to a drive's values [T], begun anew after each gap."""
    key, carried, time = (state.__name__, column, given), signals.carried, signals.time
    last = None if carried is None else carried.before(key, time[0])
    before = None if last is None or time[0] - last[0] > 1.5 / signals.rate else last[1]
    out = np.zeros_like(values)
    for part in signals.stretches():
        out[part] = state(values[part], before, *given)
        before = None
    if carried is not None:
        carried.keep(key, time, np.stack([values, out], axis=1), unknown=0.0)
    return out
