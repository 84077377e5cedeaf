"""Signals with common stamps, cut at their gaps, and their interpolation."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.arrays import Bools, Floats, Singles

from power_recordings.alignment.filters import antialias, centred
from power_recordings.reading.ordering import longest_step


@dataclass(frozen=True)
class Stream:
    """K signals at N times, in runs without gaps.

    A run ends before a step that is a gap (`longest_step`), and before a sample that is marked
    `apart` from the one before. Samples that are marked bad count as lost: they are left out.
    """

    time: Floats  # s [N], ascending
    values: Singles  # [N, K]
    period: float  # s, median
    starts: NDArray[np.intp]  # first sample of each run
    stops: NDArray[np.intp]  # one after its last

    @classmethod
    def of(
        cls, time: Floats, values: Singles, bad: Bools | None = None, apart: Bools | None = None
    ) -> 'Stream':
        """Build a stream of at least two samples; `bad` and `apart` [N] default to none."""
        steps = np.diff(time)
        period, longest = float(np.median(steps)), longest_step(steps)
        good = np.flatnonzero(np.ones(len(time), np.bool_) if bad is None else ~bad)
        begins = np.ones(len(good), np.bool_)
        begins[1:] = np.diff(time[good]) > longest
        if apart is not None:
            following = np.searchsorted(good, np.flatnonzero(apart))  # good ones at or after these
            begins[following[following < len(good)]] = True
        starts = np.flatnonzero(begins)
        stops = np.append(starts, len(good))[1:]
        if len(good) < len(time):
            time, values = time[good], values[good]
        return cls(time, values, period, starts, stops)

    def half(self, rate: float) -> int:
        """Return how many samples each end of a run loses to the filter for `rate` Hz."""
        return len(self._taps(rate)) // 2

    def _taps(self, rate: float) -> Floats:
        return antialias(round(1 / self.period, 1), rate)

    def spans(self, rate: float) -> Floats:
        """Return start and end [s] of each run after the filter for `rate` Hz, [R, 2]."""
        half = self.half(rate)
        long = self.stops - self.starts > 2 * half + 1
        first, last = self.starts[long] + half, self.stops[long] - 1 - half
        return np.stack([self.time[first], self.time[last]], axis=1).reshape(-1, 2)

    def recorded(self, times: Floats) -> Singles:
        """Return the values that were sampled at these very times, [T, K]; NaN at others."""
        place = np.clip(np.searchsorted(self.time, times), 0, len(self.time) - 1)
        same = (self.time[place] == times)[:, None]
        return np.where(same, self.values[place], np.nan).astype(np.float32)

    def sample(self, grid: Floats) -> Singles:
        """Return the values at the times of a uniform grid, [T, K]; NaN outside the runs.

        A stream that is faster than the grid is low-passed first (`filters.antialias`).
        Interpolation is by a cubic through the four nearest samples.
        """
        result = np.full((len(grid), self.values.shape[1]), np.nan, np.float32)
        if not len(grid):
            return result
        rate = 1 / (grid[1] - grid[0]) if len(grid) > 1 else np.inf
        taps = self._taps(round(rate, 1))
        half = len(taps) // 2
        for run_start, run_stop in zip(self.starts.tolist(), self.stops.tolist(), strict=True):
            if run_stop - run_start <= 2 * half + 1:
                continue
            ends = self.time[run_start + half] - _EDGE, self.time[run_stop - 1 - half] + _EDGE
            inside = slice(*np.searchsorted(grid, ends).tolist())
            if inside.start == inside.stop:
                continue
            wanted = grid[inside]
            low, high = np.searchsorted(self.time, [wanted[0], wanted[-1]]).tolist()
            start = max(run_start, low - half - 2)
            stop = min(run_stop, high + half + 3)
            times = self.time[start + half : stop - half]
            for first in range(0, self.values.shape[1], _TOGETHER):
                some = slice(first, first + _TOGETHER)
                filtered = centred(self.values[start:stop, some], taps)
                result[inside, some] = cubic(times, filtered, wanted)
        return result


_EDGE = 1e-7  # s
_TOGETHER = 8  # signals that are filtered at a time: all of twelve drives need 200 MB more


def held(time: Floats, values: NDArray[Any], grid: Floats) -> Singles:
    """Return the last finite value [T, K] up to each time of a grid [T]; NaN if none.

    time: s [N], ascending; values [N, K].
    """
    finite = np.isfinite(values)
    latest = np.where(finite, np.arange(len(values))[:, None], -1)
    latest = np.maximum.accumulate(latest, axis=0)
    row = np.searchsorted(time, grid + _EDGE, side='right') - 1
    source = np.where(row[:, None] >= 0, latest[np.maximum(row, 0)], -1)
    result = np.take_along_axis(values, np.maximum(source, 0), axis=0).astype(np.float32)
    result[source < 0] = np.nan
    return result


def cubic(time: Floats, values: Singles | Floats, at: Floats) -> Singles:
    """Interpolate values [N, K] to times `at`: [T, K], by a cubic through four samples."""
    count = len(time)
    if count < 4:
        columns = [np.interp(at, time, column) for column in values.T]
        return np.stack(columns, axis=1).astype(np.float32)
    index = np.interp(at, time, np.arange(count))
    base = np.clip(np.floor(index).astype(np.intp), 1, count - 3)
    x = index - base
    weights = (
        -x * (x - 1) * (x - 2) / 6,
        (x + 1) * (x - 1) * (x - 2) / 2,
        -(x + 1) * x * (x - 2) / 2,
        (x + 1) * x * (x - 1) / 6,
    )
    result = np.zeros((len(at), values.shape[1]), np.float32)
    for offset, weight in zip((-1, 0, 1, 2), weights, strict=True):
        result += weight[:, None].astype(np.float32) * values[base + offset]
    return result
