"""Clocks that stand still over many rows, as those of whole seconds."""

from itertools import pairwise
from typing import Final

import numpy as np
from wattwalk_core.arrays import Stamps

_REPEATED: Final = 0.5  # share of rows with the time of the row before, at least
_SLOWEST: Final = 25.0  # Hz, of changes of a clock whose rows are averaged
_FEWEST: Final = 3  # changes that tell its step


class CoarseClock:
    """Rows of one time spread evenly up to the next, block by block.

    Told by the first block with a time. In the first and the last step of a log, and where one is
    not whole in a block, rows follow as in the step beside. rows: that were spread.
    """

    def __init__(self) -> None:
        self.rows = 0
        self.step: int | None = None  # ns, 0 of a clock that is fine enough
        self._last = -1  # time of the last row, ns
        self._count = 0  # rows of it so far
        self._period = 0.0  # ns

    def spread(self, raw: Stamps) -> Stamps:
        """Return the times of a block's rows, ns [N]; negative: missing, and left so."""
        known = np.flatnonzero(raw >= 0)
        times = raw[known]
        if not len(times):
            return raw
        if self.step is None:
            self.step = _step_of(times)
        if not self.step:
            return raw
        edges = [0, *(np.flatnonzero(np.diff(times)) + 1).tolist(), len(times)]
        if not self._count:
            self._begin(times, edges)
        offsets = np.zeros(len(times))
        for start, stop in pairwise(edges):
            if times[start] != self._last:
                self._count = 0
                whole = stop < len(times) and 0 < times[stop] - times[start] <= self.step
                if whole and start:
                    self._period = float(times[stop] - times[start]) / (stop - start)
            offsets[start:stop] = (self._count + np.arange(stop - start)) * self._period
            self._last, self._count = int(times[start]), self._count + stop - start
        self.rows += len(times)
        result = raw.copy()
        result[known] = times + np.minimum(offsets, self.step - 1).astype(np.int64)
        return result

    def _begin(self, times: Stamps, edges: list[int]) -> None:
        """Let the rows of the first step end with it, as it may have begun before them."""
        assert self.step
        first, second = edges[1], edges[2] - edges[1]
        self._period = self.step / max(first, second)
        self._last, self._count = int(times[0]), max(second - first, 0)


def _step_of(times: Stamps) -> int:
    steps = np.diff(times)
    changes = steps[steps > 0]
    repeated = float(np.mean(steps == 0)) if len(steps) else 0.0
    if len(changes) < _FEWEST or repeated < _REPEATED:
        return 0
    step = int(np.median(changes))
    return step if step > 1e9 / _SLOWEST else 0
