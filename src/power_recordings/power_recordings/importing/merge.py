"""Signals of several streams put on the times of one of them, block by block."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from power_recordings.reading.ordering import longest_step

Floats = NDArray[np.float64]
Stamps = NDArray[np.int64]


@dataclass
class _Buffer:
    """The rows of one stream that are still needed."""

    width: int
    stamps: Stamps = field(default_factory=lambda: np.zeros(0, np.int64))
    values: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    longest: float = 0.0  # ns, of steps that are no gaps

    def add(self, stamps: Stamps, values: Floats) -> None:
        if not len(self.stamps):
            self.stamps, self.values = stamps, values
        else:
            self.stamps = np.concatenate([self.stamps, stamps])
            self.values = np.concatenate([self.values, values])
        if len(self.stamps) > 2:
            self.longest = 1e9 * longest_step(np.diff(self.stamps[:1000]) / 1e9)

    def at(self, stamps: Stamps) -> Floats:
        """Linear interpolation, NaN outside the rows and in gaps."""
        result = np.full((len(stamps), self.width), np.nan)
        if len(self.stamps) < 2:
            if len(self.stamps):
                result[stamps == self.stamps[0]] = self.values[0]
            return result
        right = np.clip(np.searchsorted(self.stamps, stamps), 1, len(self.stamps) - 1)
        left = right - 1
        span = (self.stamps[right] - self.stamps[left]).astype(np.float64)
        weight = (stamps - self.stamps[left]) / span
        rows = self.values[left] * (1 - weight)[:, None] + self.values[right] * weight[:, None]
        for end, side in ((0.0, left), (1.0, right)):
            rows[weight == end] = self.values[side[weight == end]]
        exact = (weight == 0) | (weight == 1)
        inside = (weight >= 0) & (weight <= 1) & ((span <= self.longest) | exact)
        result[inside] = rows[inside]
        return result

    def forget(self, before: int) -> None:
        keep = max(int(np.searchsorted(self.stamps, before)) - 1, 0)
        self.stamps, self.values = self.stamps[keep:], self.values[keep:]


class Merger:
    """
    Columns of several streams on the times of the first.

    widths: columns of each stream, the reference first. `add` takes rows as they are read; `take`
    gives the reference's rows, all columns side by side, as far as every stream has come.
    """

    def __init__(self, widths: Sequence[int]) -> None:
        self._reference, *self._others = (_Buffer(width) for width in widths)
        self._all = [self._reference, *self._others]
        self._done = [False] * len(widths)

    def add(self, stream: int, stamps: Stamps, values: Floats) -> None:
        """Add rows [N, K] of a stream, stamps ascending."""
        self._all[stream].add(stamps, values)

    def take(self, *, final: bool = False) -> tuple[Stamps, Floats]:
        """Return stamps [N] and values [N, sum of widths]; with final, all rows that are left."""
        reference = self._reference
        count = len(reference.stamps)
        if not final:
            for other in self._others:
                last = int(other.stamps[-1]) if len(other.stamps) else -1
                count = min(count, int(np.searchsorted(reference.stamps, last, side='right')))
        stamps, rows = reference.stamps[:count], reference.values[:count]
        reference.stamps, reference.values = reference.stamps[count:], reference.values[count:]
        if not self._others or not count:
            width = sum(buffer.width for buffer in self._all)
            return stamps, rows if count else np.zeros((0, width))
        merged = np.concatenate([rows, *(other.at(stamps) for other in self._others)], axis=1)
        for other in self._others:
            other.forget(int(stamps[-1]))
        return stamps, merged
