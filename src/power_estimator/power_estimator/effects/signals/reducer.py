"""Low-pass and decimation of products and power, alike for all."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from power_recordings.alignment.filters import windowed_sinc

Floats = NDArray[np.float64]

CUTOFF = 12.5
"""Hz, of the zero-phase low-pass that products and power pass alike (Section II-A)."""
REDUCED_RATE = 50.0
HALF_WIDTH = 0.2  # s, of the low-pass
EARLIEST, LATEST, SHIFT_STEP = -0.006, 0.022, 0.001
"""Delays of the power against the joint signals that a fit tries, s."""
_BETA = 4.9  # of its Kaiser window: 53 dB beyond 16.5 Hz
_TOGETHER = 16  # outputs made by one matrix product


@dataclass(frozen=True)
class Reducer:
    """
    Low-pass at 12.5 Hz and decimation, the same for every product and for the power.

    With a window in s it is the mean over that window: energy, for meters that are slow.
    """

    rate: float
    slices: tuple[slice, ...]  # stretches of the input that are long enough
    window: float = 0.0

    @property
    def factor(self) -> int:
        """Input samples for each reduced one."""
        return max(1, round(self.rate / REDUCED_RATE))

    @property
    def margin(self) -> int:
        """Input samples lost at each end of a stretch: filter and largest shift."""
        half = max(HALF_WIDTH, self.window / 2)
        return round(self.rate * (half + max(LATEST, -EARLIEST))) + 1

    def reduce(self, values: Floats | NDArray[np.float32], shift: float = 0.0) -> Floats:
        """[T, ...] → [N, ...]: the low-passed values at time t + shift (s)."""
        taps = self._taps(shift)
        start = self.margin - len(taps) // 2
        parts = [
            _known(np.asarray(values[part], np.float64)[start:], taps, self.factor, count)
            for part in self.slices
            if (count := self._count(part))
        ]
        return np.concatenate(parts) if parts else np.empty((0, *values.shape[1:]))

    def centres(self) -> NDArray[np.intp]:
        """Index of the input sample at the middle of each reduced one, [N]."""
        return np.concatenate(
            [
                part.start + self.margin + self.factor * np.arange(self._count(part))
                for part in self.slices
            ]
            or [np.empty(0, dtype=np.intp)]
        )

    def stretches(self) -> list[slice]:
        """Gap-free stretches of the reduced samples."""
        out, start = [], 0
        for part in self.slices:
            out.append(slice(start, start + self._count(part)))
            start += self._count(part)
        return out

    def _count(self, part: slice) -> int:
        return max(0, (part.stop - part.start - 2 * self.margin - 1) // self.factor + 1)

    def _taps(self, shift: float) -> Floats:
        half = self.margin - 1
        time = np.arange(-half, half + 1) / self.rate - shift
        if self.window:
            inside = np.abs(time) <= self.window / 2
            return np.asarray(inside / inside.sum(), np.float64)[::-1]
        return windowed_sinc(time, CUTOFF, HALF_WIDTH, _BETA)[::-1]


def _known(values: Floats, taps: Floats, factor: int, count: int) -> Floats:
    """As `_decimated`, NaN where a value that is not known counts."""
    unknown = ~np.isfinite(values)
    if not unknown.any():
        return _decimated(values, taps, factor, count)
    out = _decimated(np.where(unknown, 0.0, values), taps, factor, count)
    reached = _decimated(unknown.astype(np.float64), np.abs(taps), factor, count)
    out[reached > 0.0] = np.nan
    return out


def _decimated(values: Floats, taps: Floats, factor: int, count: int) -> Floats:
    """
    FIR filter and decimation of values [T, ...] to [count, ...].

    Output i is the sum over k of taps[k]·values[i·factor + len(taps) − 1 − k]. A matrix product
    makes a few outputs at once from the stretch of input that they share, without copies: two
    orders of magnitude less work than the phases of the filter one by one.
    """
    used = np.flatnonzero(taps[::-1])
    weights = taps[::-1][used[0] : used[-1] + 1]
    width = int(np.prod(values.shape[1:]))
    rows = np.ascontiguousarray(values).reshape(len(values), width)[used[0] :]
    together = min(_TOGETHER, count)
    filters = np.zeros((together, (together - 1) * factor + len(weights)))
    for place in range(together):
        filters[place, place * factor : place * factor + len(weights)] = weights
    out = np.empty((count, width))
    whole = count // together
    step, item = rows.strides
    windows = np.lib.stride_tricks.as_strided(
        rows, (whole, filters.shape[1], width), (together * factor * step, step, item)
    )
    np.matmul(filters, windows, out=out[: whole * together].reshape(whole, together, width))
    left = count - whole * together
    if left:
        needed = (left - 1) * factor + len(weights)
        last = rows[whole * together * factor :][:needed]
        out[whole * together :] = filters[:left, :needed] @ last
    return out.reshape(count, *values.shape[1:])
