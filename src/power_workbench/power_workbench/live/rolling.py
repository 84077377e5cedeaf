"""Measured power and estimates of the last seconds, brought together in rows of 20 ms."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Doubles = NDArray[np.float64]
Stamps = NDArray[np.int64]

PERIOD = 20_000_000
"""ns, that a row covers."""
_PATIENCE = 300_000_000  # ns, that an estimate may come after its measurement, or before it
_KEPT = 3_000_000_000  # ns of measurements
_MOST_WAITING = 500  # estimates


@dataclass(frozen=True)
class PowerRows:
    """Mean power over the 20 ms before each stamp, W [N, D + 1]; NaN where unknown.

    The last column is the sum: of the drives that are estimated, where there is an estimate.
    """

    stamp_ns: Stamps  # [N], ascending
    names: tuple[str, ...]  # [D]
    measured: Doubles
    estimate: Doubles


class RollingPower:
    """Takes measurements and estimates in the order of their stamps, and gives rows once.

    A row ends at the stamp of an estimate, so that both cover the same time. While no estimate
    comes, rows follow one another without one.
    """

    def __init__(self) -> None:
        self.names: tuple[str, ...] = ()
        self._forget()

    def _forget(self) -> None:
        self._stamps: Stamps = np.zeros(0, np.int64)
        self._power: Doubles = np.zeros((0, len(self.names)))
        self._waiting: deque[tuple[int, Doubles]] = deque(maxlen=_MOST_WAITING)
        self._end = 0  # of the last row

    def measured(self, names: Sequence[str], stamp_ns: Stamps, power: Doubles) -> None:
        """Take measured power in W [n, D], NaN for samples that do not count."""
        self._use(names)
        if len(self._stamps) and len(stamp_ns) and stamp_ns[0] < self._stamps[-1] - _KEPT:
            self._forget()  # time was set back: another simulation
        columns = [list(names).index(name) if name in names else -1 for name in self.names]
        given = np.full((len(stamp_ns), len(self.names)), np.nan)
        known = [i for i, column in enumerate(columns) if column >= 0]
        given[:, known] = power[:, [columns[i] for i in known]]
        self._stamps = np.concatenate([self._stamps, stamp_ns])
        self._power = np.concatenate([self._power, given])
        recent = self._stamps > self._stamps[-1] - _KEPT if len(self._stamps) else slice(None)
        self._stamps, self._power = self._stamps[recent], self._power[recent]

    def estimated(self, names: Sequence[str], stamp: int, power: Doubles) -> None:
        """Take an estimate in W [D] over the 20 ms before its stamp (ns)."""
        self._use(names)
        row = np.full(len(self.names), np.nan)
        for name, value in zip(names, power.tolist(), strict=True):
            row[self.names.index(name)] = value
        if self._waiting and stamp < self._waiting[-1][0] - _KEPT:
            self._forget()
        self._waiting.append((stamp, row))

    def rows(self) -> PowerRows | None:
        """Return the rows that are complete since the last call, None without one."""
        newest = int(self._stamps[-1]) if len(self._stamps) else 0
        last = self._waiting[-1][0] if self._waiting else 0
        ends: list[int] = []
        estimates: list[Doubles] = []
        unknown = np.full(len(self.names), np.nan)
        while self._waiting and self._waiting[0][0] <= max(newest, last - _PATIENCE):
            end, row = self._waiting.popleft()
            if end > self._end:
                self._fill(ends, end - PERIOD)
                estimates += [unknown] * (len(ends) - len(estimates))
                ends.append(end)
                estimates.append(row)
                self._end = end
        self._fill(ends, newest - _PATIENCE)
        estimates += [unknown] * (len(ends) - len(estimates))
        if not ends:
            return None
        stamps = np.array(ends, np.int64)
        measured, estimate = self._means(stamps), np.array(estimates)
        return PowerRows(stamps, self.names, *_with_sum(measured, estimate))

    def _fill(self, ends: list[int], until: int) -> None:
        """Rows without an estimate from the last one to a stamp."""
        if not len(self._stamps):
            return
        self._end = max(self._end, int(self._stamps[0]))
        while self._end + PERIOD <= until:
            self._end += PERIOD
            ends.append(self._end)

    def _means(self, ends: Stamps) -> Doubles:
        """Mean of the measured samples in the 20 ms before each end, [N, D]."""
        known = np.isfinite(self._power)
        blank = np.zeros((1, len(self.names)))
        sums = np.concatenate([blank, np.cumsum(np.where(known, self._power, 0.0), axis=0)])
        counts = np.concatenate([blank, np.cumsum(known, axis=0)])
        first = np.searchsorted(self._stamps, ends - PERIOD, side='right')
        past = np.searchsorted(self._stamps, ends, side='right')
        number = counts[past] - counts[first]
        total = sums[past] - sums[first]
        return np.where(number > 0, total / np.maximum(number, 1.0), np.nan)

    def _use(self, names: Sequence[str]) -> None:
        """Keep columns for drives that come later than others, too."""
        new = [name for name in names if name not in self.names]
        if not new:
            return
        self.names = (*self.names, *new)
        more = np.full((len(self._power), len(new)), np.nan)
        self._power = np.concatenate([self._power, more], axis=1)
        blank = np.full(len(new), np.nan)
        for index, (stamp, row) in enumerate(self._waiting):
            self._waiting[index] = (stamp, np.concatenate([row, blank]))


def _with_sum(measured: Doubles, estimate: Doubles) -> tuple[Doubles, Doubles]:
    """Append the sums over the drives that are known in both, or in the only one there is."""
    both = np.isfinite(measured) & np.isfinite(estimate)
    out = []
    for values in (measured, estimate):
        known = np.isfinite(values)
        counted = np.where(both.any(axis=1, keepdims=True), both, known)
        total = np.where(counted, np.nan_to_num(values), 0.0).sum(axis=1, keepdims=True)
        total[~known.any(axis=1)] = np.nan
        out.append(np.concatenate([values, total], axis=1))
    return out[0], out[1]
