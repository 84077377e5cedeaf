"""Least and greatest values of signals in blocks, so that any span is drawn at once."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.arrays import Singles

FACTOR = 4
"""Blocks of one level in a block of the next."""
_BROADEST = 4096
"""Blocks that the last level may have."""


@dataclass(frozen=True)
class Span:
    """Least and greatest value of each block of a span; NaN where a block has none."""

    start: int  # slot at which the first block begins
    step: int  # slots of a block
    low: Singles  # [K, M]
    high: Singles  # [K, M]

    @property
    def centres(self) -> NDArray[np.float64]:
        """Middle of each block in slots [K]."""
        blocks = np.arange(len(self.low), dtype=np.float64)
        return np.asarray(self.start + self.step * (blocks + 0.5) - 0.5, np.float64)


class Pyramid:
    """Signals of M columns on evenly spaced slots, with their extremes in blocks of many sizes."""

    def __init__(self, values: Singles) -> None:
        """values: [N, M], NaN where nothing is known."""
        self._levels: list[tuple[Singles, Singles]] = [(values, values)]
        while len(self._levels[-1][0]) > _BROADEST:
            low, high = self._levels[-1]
            self._levels.append((_joined(low, FACTOR, np.fmin), _joined(high, FACTOR, np.fmax)))

    def span(self, start: int, stop: int, most: int) -> Span:
        """Return extremes from slot start to stop in about `most` blocks, at most twice as many.

        What is drawn of them is what would be drawn of all samples, whatever the span.
        """
        start = max(0, start)
        stop = max(start, min(len(self._levels[0][0]), stop))
        wanted = max(1, -(-(stop - start) // max(1, most)))
        level = 0
        while level + 1 < len(self._levels) and FACTOR ** (level + 1) <= wanted:
            level += 1
        size = FACTOR**level
        first, last = start // size, -(-stop // size)
        low, high = (values[first:last] for values in self._levels[level])
        return _span(first * size, size, low, high, wanted // size)


def extremes(values: Singles, start: int, stop: int, most: int) -> Span:
    """Return extremes of values [N, M] from slot start to stop, in `most` blocks at most."""
    part = values[start:stop]
    return _span(start, 1, part, part, -(-len(part) // most))


def _span(start: int, size: int, low: Singles, high: Singles, count: int) -> Span:
    """Join extremes in blocks of `size` slots to extremes in `count` times as large ones."""
    if count > 1:
        low, high = _joined(low, count, np.fmin), _joined(high, count, np.fmax)
    return Span(start, size * max(1, count), low, high)


def _joined(values: Singles, count: int, extreme: np.ufunc) -> Singles:
    if not len(values):
        return values
    starts = np.arange(0, len(values), count)
    out: Singles = extreme.reduceat(values, starts, axis=0)
    return out
