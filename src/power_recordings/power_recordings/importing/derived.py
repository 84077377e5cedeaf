"""Velocity of drives whose log has none: the rate of their position."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from power_recordings.reading.ordering import longest_step

Floats = NDArray[np.float64]
Stamps = NDArray[np.int64]

HALF_WINDOW: Final = 0.01  # s
_TURN: Final = 2 * np.pi


@dataclass
class PositionRates:
    """
    Central differences of some columns, as rows come.

    v[i] = (q[i + w] − q[i − w]) / (t[i + w] − t[i − w]), with w the rows of 10 ms, at least one.
    It does not lag; it is NaN at both ends and across gaps. A position within one turn that
    jumps by more than half of it is taken for one that wraps.
    """

    columns: Sequence[int]
    _stamps: Stamps = field(default_factory=lambda: np.zeros(0, np.int64))
    _rows: Floats | None = None
    _fresh: int = 0  # first row that was not given out
    _half: int = 0

    def extend(self, stamps: Stamps, rows: Floats, *, final: bool) -> tuple[Stamps, Floats]:
        """Take rows [N, K]; return those that are complete, rates after their columns."""
        if self._rows is not None:
            stamps = np.concatenate([self._stamps, stamps])
            rows = np.concatenate([self._rows, rows])
        if not self._half and len(stamps) > 2:
            period = float(np.median(np.diff(stamps))) / 1e9
            self._half = max(1, round(HALF_WINDOW / period))
        count, half = len(stamps), max(self._half, 1)
        stop = count if final else max(count - half, self._fresh)
        out = slice(self._fresh, stop)
        rates = self._rates(stamps, rows, half)[out]
        keep = max(stop - half, 0)
        self._stamps, self._rows, self._fresh = stamps[keep:], rows[keep:], stop - keep
        return stamps[out], np.concatenate([rows[out], rates], axis=1)

    def _rates(self, stamps: Stamps, rows: Floats, half: int) -> Floats:
        result = np.full((len(rows), len(self.columns)), np.nan)
        if len(rows) <= 2 * half:
            return result
        span = (stamps[2 * half :] - stamps[: -2 * half]) / 1e9
        whole = span <= longest_step(span)
        for k, column in enumerate(self.columns):
            position = rows[:, column].copy()
            finite = np.isfinite(position)
            if finite.any() and np.ptp(position[finite]) <= 1.01 * _TURN:
                position[finite] = np.unwrap(position[finite], period=_TURN)
            steps = position[2 * half :] - position[: -2 * half]
            result[half:-half, k] = np.where(whole, steps / span, np.nan)
        return result
