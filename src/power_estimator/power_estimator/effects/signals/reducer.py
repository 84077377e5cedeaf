"""Low-pass and decimation of products and power, alike for all."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray
from power_recordings.alignment.filters import windowed_sinc
from wattwalk_core.arrays import Floats, Singles

CUTOFF = 12.5  # Hz, of the zero-phase low-pass that products and power pass alike (Section II-A)
REDUCED_RATE = 50.0
HALF_WIDTH = 0.2  # s, of the low-pass
EARLIEST, LATEST, SHIFT_STEP = -0.006, 0.022, 0.001
"""Delays of the power against the joint signals that a fit tries, s."""
_BETA = 4.9  # of its Kaiser window: 53 dB beyond 16.5 Hz
_TOGETHER = 16  # outputs made by one matrix product
_FINE = 100.0  # samples a second: what folds down onto the rows is faster than 83 Hz


@dataclass(frozen=True)
class Reducer:
    """Low-pass at 12.5 Hz and decimation to 50 Hz or less, the same for products and power.

    With a window in s it is the mean over that window: energy, for slow meters. Steady operating
    points are taken one by one.
    """

    rate: float
    slices: tuple[slice, ...]  # stretches of the input that are long enough
    window: float = 0.0
    steady: bool = False  # rows are operating points
    every: int = 1  # of the rows at 50 Hz, one of so many is made

    @property
    def factor(self) -> int:
        """Number of input samples for each reduced one."""
        return 1 if self.steady else self.every * max(1, round(self.rate / REDUCED_RATE))

    def sparse(self) -> 'Reducer':
        """Return a reducer to every so many rows that 25 a second are left, or a few more.

        The low-pass makes rows 40 ms apart nearly independent (its autocorrelation there is 0.08).
        """
        dense = replace(self, every=1)
        apart = int(self.rate / (2 * CUTOFF * dense.factor) + 1e-6)
        return self if self.steady else replace(dense, every=max(1, apart))

    @cached_property
    def margin(self) -> int:
        """Number of input samples lost at each end of a stretch, to filter and largest shift."""
        if self.steady:
            return 0
        half = max(HALF_WIDTH, self.window / 2)
        return round(self.rate * (half + max(LATEST, -EARLIEST))) + 1

    def reduce(self, values: Floats | Singles, shift: float = 0.0) -> Floats:
        """Return values [T, …] low-passed at time t + shift (s), decimated to [N, …]."""
        if self.steady:
            return np.array(values, np.float64)
        taps = self._taps(shift)
        start = self.margin - len(taps) // 2
        slices = [slice(part.start + start, part.stop) for part in self.slices]
        return self._by_stretch(values, slices, taps, self.factor)

    def thin(self, values: Floats) -> Floats:
        """Return means [K, …] of a few samples of a signal [T, …], _FINE a second or more."""
        if self._stride == 1:
            return values
        parts = []
        for part, count in zip(self.slices, self._thin_counts, strict=True):
            own = values[part.start + 1 :][: count * self._stride]
            # A mean over an axis this short costs ten times as much.
            parts.append(sum(own[first :: self._stride] for first in range(self._stride)))
        return np.concatenate(parts) / self._stride

    def reduce_thin(self, values: Floats) -> Floats:
        """Return a thinned signal [K, …] low-passed and decimated to [N, …] as by `reduce`."""
        if self._stride == 1:
            return self.reduce(values)
        ends = itertools.accumulate(self._thin_counts, initial=0)
        slices = [slice(start, stop) for start, stop in itertools.pairwise(ends)]
        return self._by_stretch(values, slices, self._thin_taps, self.factor // self._stride)

    @cached_property
    def _thin_counts(self) -> list[int]:
        """Number of means of each stretch, whose first sample has no place in the filter."""
        return [max(0, part.stop - part.start - 1) // self._stride for part in self.slices]

    @cached_property
    def _thin_taps(self) -> Floats:
        stride, half = self._stride, self.margin - 1
        places = stride * np.arange(2 * half // stride, dtype=np.float64) + 0.5 * (stride - 1)
        return windowed_sinc((places - half) / self.rate, CUTOFF, HALF_WIDTH, _BETA)[::-1]

    @cached_property
    def _stride(self) -> int:
        """Samples in a mean; 1 of operating points, and where a window already takes the mean."""
        most = 1 if self.window else max(1, int(self.rate / _FINE))
        return max(n for n in range(1, most + 1) if self.factor % n == 0)

    def _by_stretch(
        self, values: Floats | Singles, slices: Sequence[slice], taps: Floats, factor: int
    ) -> Floats:
        """Return values [L, …] reduced to [N, …]; slices: of these, by stretch."""
        stretches = self.stretches()
        rows = _by_time(values)  # [k, L]
        out = np.empty((len(rows), stretches[-1].stop if stretches else 0))
        for places in self._alike:
            parts = [rows[:, slices[place]] for place in places]
            together = parts[0] if len(parts) == 1 else np.concatenate(parts)
            reduced = _known(together, taps, factor, self._count(self.slices[places[0]]))
            for part, place in zip(np.split(reduced, len(places)), places, strict=True):
                out[:, stretches[place]] = part
        return out.T.reshape(out.shape[1], *values.shape[1:])

    @cached_property
    def overlap(self) -> float:
        """Correlation of white noise in a row with that in the next."""
        if self.steady:
            return 0.0
        taps = self._taps(0.0)
        return float(taps[self.factor :] @ taps[: -self.factor] / (taps @ taps))

    @cached_property
    def _alike(self) -> list[list[int]]:
        """Stretches of one length, by place: one matrix product reduces them together."""
        found: dict[int, list[int]] = {}
        for place, part in enumerate(self.slices):
            if self._count(part):
                found.setdefault(part.stop - part.start, []).append(place)
        return list(found.values())

    def centres(self) -> NDArray[np.intp]:
        """Return the index of the input sample at the middle of each reduced one, [N]."""
        parts = (
            part.start + self.margin + self.factor * np.arange(self._count(part))
            for part in self.slices
        )
        return np.concatenate([np.empty(0, dtype=np.intp), *parts])

    def stretches(self) -> list[slice]:
        """Return the gap-free stretches of the reduced samples, as slices of rows."""
        ends = np.cumsum([self._count(part) for part in self.slices]).tolist()
        return [slice(start, stop) for start, stop in itertools.pairwise([0, *ends])]

    def _count(self, part: slice) -> int:
        return max(0, (part.stop - part.start - 2 * self.margin - 1) // self.factor + 1)

    def _taps(self, shift: float) -> Floats:
        return _filter(self.margin - 1, self.rate, self.window, shift)


@lru_cache(64)
def _filter(half: int, rate: float, window: float, shift: float) -> Floats:
    """Coefficients of the low-pass at a delay, newest sample first; not to be changed."""
    time = np.arange(-half, half + 1) / rate - shift
    if window:
        inside = np.abs(time) <= window / 2
        return np.asarray(inside / inside.sum(), np.float64)[::-1]
    return windowed_sinc(time, CUTOFF, HALF_WIDTH, _BETA)[::-1]


def _by_time(values: Floats | Singles) -> Floats:
    """Values [T, ...] as rows [k, T] of one signal each; no copy where they lie so."""
    rows = np.ascontiguousarray(np.moveaxis(values, 0, -1), dtype=np.float64)
    return rows.reshape(int(np.prod(values.shape[1:])), len(values))


def _known(rows: Floats, taps: Floats, factor: int, count: int) -> Floats:
    """As `_decimated`, NaN where a value that is not known counts."""
    if np.isfinite(rows.sum()):
        return _decimated(rows, taps, factor, count)
    unknown = ~np.isfinite(rows)
    out = _decimated(np.where(unknown, 0.0, rows), taps, factor, count)
    reached = _decimated(unknown.astype(np.float64), np.abs(taps), factor, count)
    out[reached > 0.0] = np.nan
    return out


def _decimated(rows: Floats, taps: Floats, factor: int, count: int) -> Floats:
    """FIR filter and decimation of rows [k, L] to [k, count].

    Output i is the sum over j of taps[j]·row[i·factor + len(taps) − 1 − j]. A matrix product
    makes a few outputs at once from the stretch of input that they share, without copies: two
    orders of magnitude less work than the phases of the filter one by one.
    """
    used = np.flatnonzero(taps[::-1])
    weights = taps[::-1][used[0] : used[-1] + 1]
    rows = rows[:, used[0] :]
    together = min(_TOGETHER, count)
    filters = np.zeros(((together - 1) * factor + len(weights), together))
    for place in range(together):
        filters[place * factor : place * factor + len(weights), place] = weights
    whole = count // together
    step, item = rows.strides
    windows = np.lib.stride_tricks.as_strided(
        rows, (whole, len(rows), len(filters)), (together * factor * item, step, item)
    )
    out = np.empty((len(rows), count))
    made = np.matmul(windows, filters)  # [whole, k, together]
    out[:, : whole * together] = made.transpose(1, 0, 2).reshape(len(rows), whole * together)
    left = count - whole * together
    if left:
        needed = (left - 1) * factor + len(weights)
        last = rows[:, whole * together * factor :][:, :needed]
        out[:, whole * together :] = last @ filters[:needed, :left]
    return out
