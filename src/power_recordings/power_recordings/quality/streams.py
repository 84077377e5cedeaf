"""Rate, jitter, gaps and updates of sampled signals."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.arrays import Bools, Floats, Singles, Stamps

from power_recordings.reading.ordering import longest_step

LEAST_UPDATES = 25.0  # changes a second; fewer do not resolve the power of a joint
_SLOW = 2.0  # changes a second, below which stretches hold too few to count
_PAUSE = 0.1  # s without rows that may be jitter
_EACH_ROW = 0.8  # share of rows that change from which on each row is an update


@dataclass(frozen=True)
class Timing:
    """Rate, gaps and jitter of a topic's samples.

    rate: 1/median step, Hz. jitter: half of the span from the 1st to the 99th percentile of the
    steps, as a share of the median. gap_seconds: sum of the steps that are gaps.
    """

    samples: int
    rate: float
    jitter: float
    gaps: int
    gap_seconds: float


@dataclass(frozen=True)
class SampleLoss:
    """Number of samples missing by a topic's sequence numbers, and of gaps.

    A number that goes back is a new start, no loss.
    """

    samples: int
    gaps: int


def timing(stamps: Stamps) -> Timing:
    """Return the timing of ascending stamps [N] in ns."""
    steps = np.diff(stamps) / 1e9
    steps = steps[steps > 0]
    if not len(steps):
        return Timing(len(stamps), 0.0, 0.0, 0, 0.0)
    period = float(np.median(steps))
    longest = longest_step(steps)
    usual = steps[steps <= longest]
    low, high = np.percentile(usual, [1, 99])
    gaps = steps[steps > longest]
    jitter = float(high - low) / 2 / period
    return Timing(len(stamps), 1 / period, jitter, len(gaps), float(gaps.sum()))


def updates(stamps: Stamps, values: Singles) -> Floats:
    """Return how often each of the columns [N, K] changes, in changes a second [K].

    stamps: ns [N]. Gaps and rest do not count: the result is the median rate over stretches of 2 s
    with changes, or, below 2 Hz, that of the times between changes. Where over 80 % of rows
    change, repeats count as chance, and the rate is that of the rows.
    """
    seconds = (stamps - stamps[0]) / 1e9
    if len(seconds) < 3 or seconds[-1] <= 0:
        return np.zeros(values.shape[1])
    changed = (np.diff(values, axis=0) != 0) & np.isfinite(values[1:])
    length = min(2.0, float(seconds[-1]))
    stretch = np.minimum((seconds[1:] / length).astype(int), int(seconds[-1] / length))
    steps = np.diff(seconds)
    period = max(float(np.median(steps)), 1e-9)
    covered = np.where(steps > max(longest_step(steps), _PAUSE), period, steps)
    known = np.bincount(stretch, weights=covered)
    counts = np.stack([np.bincount(stretch, weights=column) for column in changed.T], axis=1)
    rows = np.bincount(stretch, minlength=len(counts))
    full = rows >= 0.5 * rows.max(initial=1)
    result = np.zeros(values.shape[1])
    for k, column in enumerate(counts[full].T):
        alive = column > 0
        result[k] = np.median(column[alive] / known[full][alive]) if alive.any() else 0.0
        between = np.diff(seconds[1:][changed[:, k]])
        if result[k] < _SLOW and len(between):
            result[k] = min(result[k], 1 / float(np.median(between)))
    rate = 1 / period
    return np.where(result > _EACH_ROW * rate, np.maximum(result, round(rate, 3)), result)


def clipped(values: Singles) -> float:
    """Return the share of samples [N] that repeat the extreme value of the sample before.

    Extremes near zero (below 20 % of the largest magnitude) do not count.
    """
    finite = values[np.isfinite(values)]
    if len(finite) < 20 or finite.min() == finite.max():
        return 0.0
    least = 0.2 * float(np.abs(finite).max())
    at = ((finite == finite.max()) | (finite == finite.min())) & (np.abs(finite) > least)
    held = at[1:] & at[:-1] & (finite[1:] == finite[:-1])
    return float(held.mean())


def frozen(stamps: Stamps, values: Singles, moving: Bools) -> float:
    """Return the longest time [s] in motion (`moving` [N]) for which a signal [N] is constant."""
    if len(values) < 2:
        return 0.0
    steps = np.diff(stamps) / 1e9 * moving[1:]
    in_motion = np.r_[0.0, np.cumsum(steps)]
    same = np.diff(values) == 0
    edges = np.flatnonzero(np.diff(np.r_[0, same.astype(np.int8), 0]))
    first, last = edges[::2], edges[1::2]
    return float((in_motion[last] - in_motion[first]).max(initial=0.0))


def values_at(stamps: NDArray[np.int64], values: Singles, wanted: NDArray[np.int64]) -> Floats:
    """Return values [M] at wanted stamps [M]: means of a faster signal, or interpolated.

    stamps: ns [N]; values: [N]. NaN where there are none.
    """
    finite = np.isfinite(values)
    if finite.sum() < 2:
        return np.full(len(wanted), np.nan)
    t, v = stamps[finite].astype(np.float64), values[finite].astype(np.float64)
    edges = np.r_[wanted[0], (wanted[1:] + wanted[:-1]) / 2, wanted[-1]].astype(np.float64)
    ratio = np.median(np.diff(wanted)) / max(float(np.median(np.diff(t))), 1.0)
    if ratio < 1.5:
        return np.interp(wanted.astype(np.float64), t, v, np.nan, np.nan)
    total = np.r_[0.0, np.cumsum(v)]
    low, high = np.searchsorted(t, edges[:-1]), np.searchsorted(t, edges[1:])
    count = high - low
    with np.errstate(invalid='ignore', divide='ignore'):
        return np.where(count > 0, (total[high] - total[low]) / count, np.nan)
