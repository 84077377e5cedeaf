"""Rows of several streams put on the times of one of them, as they arrive.

The rule is that of an import (`power_recordings.importing.channel_group`): values of the other
streams are interpolated linearly, and missing where their rows are over 2.5 periods apart.
"""

from collections import deque
from dataclasses import dataclass
from math import nan
from statistics import median
from typing import Generic, NamedTuple, TypeVar

from power_recordings.reading.ordering import GAP

T = TypeVar('T')
_REMEMBERED = 512  # rows of a stream that wait for another one
_INTERVALS = 15
CYCLIC = 1.75  # periods between rows of a cyclic sender from which on one is lost, not late


class MergedRow(NamedTuple, Generic[T]):
    """A row on the reference's time (ns): its number, and by stream the rows on both sides of it.

    A value is left + weight · (right − left); weight is NaN where the stream has none. The number
    grows by more than one where the reference lost rows.
    """

    number: int
    time: int
    left: list[T]
    right: list[T]
    weight: list[float]


@dataclass
class _Stream(Generic[T]):
    """The rows of one stream that are still needed, and its period in ns."""

    rows: deque[tuple[int, T]]
    intervals: deque[int]
    period: float
    loss: float
    hold: float
    seen: bool = False
    missing: int = 0

    def add(self, time: int, row: T) -> None:
        if self.rows:
            interval = time - self.rows[-1][0]
            if interval > self.loss * self.period:
                self.missing += round(interval / self.period) - 1
            self.intervals.append(interval)
            if len(self.intervals) > 2:
                self.period = median(self.intervals)
        self.rows.append((time, row))
        self.seen = True

    def is_silent(self, now: int, since: int = 0) -> bool:
        return not self.rows or now - max(self.rows[-1][0], since) > GAP * self.period

    def at(self, time: int) -> tuple[T, T, float] | None:
        """Return the rows around a time and the weight of the later; None where there are none."""
        before = after = None
        for row in self.rows:
            if row[0] == time:
                return row[1], row[1], 1.0
            if row[0] > time:
                after = row
                break
            before = row
        if before is not None and after is not None:
            span = after[0] - before[0]
            if span <= GAP * self.period:
                return before[1], after[1], (time - before[0]) / span
        for near in (before, after):
            if near is not None and abs(near[0] - time) < self.hold * self.period:
                return near[1], near[1], 1.0
        return None

    def forget(self, before: int) -> None:
        """Drop the rows before a time but the last of them."""
        while len(self.rows) > 1 and self.rows[1][0] <= before:
            self.rows.popleft()


class StreamMerger(Generic[T]):
    """Merges streams whose rows come one by one; the reference is the first that is not silent.

    A stream is silent, and is no longer waited for, once it lags the newest row by more than 2.5
    periods, but for pauses of all streams. Rows before the first of another stream are left out.
    period: nominal, in ns; that of each stream is learned from its rows. empty: stands for the
    row of a stream that has none. loss: periods between two rows from which on others count as
    lost between them; missing has their number by stream. hold: periods for which a row stands
    beside a gap.
    """

    def __init__(
        self, streams: int, period: float, empty: T, loss: float = GAP, hold: float = 0.0
    ) -> None:
        self._streams: list[_Stream[T]] = [
            _Stream(deque(maxlen=_REMEMBERED), deque(maxlen=_INTERVALS), period, loss, hold)
            for _ in range(streams)
        ]
        self._empty = empty
        self._loss = loss
        self._grace = 2 * GAP * period  # ns that a stream may come later than the first
        self._begin: int | None = None
        self._newest = self._resumed = 0  # times of the newest row, and of that after all paused
        self._given: tuple[int, int] | None = None  # number and time of the last row given out
        self.lost = 0
        self.out_of_order = 0

    @property
    def count(self) -> int:
        """Rows so far, given out or lost."""
        return 0 if self._given is None else self._given[0] + 1

    @property
    def missing(self) -> list[int]:
        """Number of rows of each stream that did not come, by its gaps."""
        return [stream.missing for stream in self._streams]

    def silent(self, now: int) -> list[int]:
        """Return the indices of the streams that are silent at a time in ns."""
        return [k for k, stream in enumerate(self._streams) if stream.is_silent(now)]

    def seen(self, stream: int) -> bool:
        """Return whether a stream has ever had a row."""
        return self._streams[stream].seen

    def add(self, stream: int, time: int, row: T) -> list[MergedRow[T]]:
        """Take a row of a stream at a time in ns; return the merged rows that are complete."""
        own = self._streams[stream]
        if own.rows and time <= own.rows[-1][0]:
            self.out_of_order += 1
            return []
        own.add(time, row)
        if time - self._newest > GAP * own.period:
            self._resumed = time
        self._newest = max(self._newest, time)
        if self._begin is None and not self._has_begun():
            return []
        merged: list[MergedRow[T]] = []
        while (complete := self._next()) is not None:
            merged.append(complete)
        return merged

    def _has_begun(self) -> bool:
        """Return whether all streams have a row, or are no longer waited for."""
        first = [stream.rows[0][0] for stream in self._streams if stream.seen]
        if len(first) < len(self._streams) and self._newest - min(first) < self._grace:
            return False
        self._begin = max(first)
        return True

    def _next(self) -> MergedRow[T] | None:
        waited = [s for s in self._streams if not s.is_silent(self._newest, self._resumed)]
        after = self._given[1] + 1 if self._given is not None else self._begin or 0
        reference = waited[0]
        time = next((t for t, _ in reference.rows if t >= after), None)
        if time is None or any(stream.rows[-1][0] < time for stream in waited):
            return None
        number = self._number(time, reference.period)
        left, right, weight = [], [], []
        for stream in self._streams:
            found = stream.at(time) or (self._empty, self._empty, nan)
            left.append(found[0])
            right.append(found[1])
            weight.append(found[2])
            stream.forget(time)
        return MergedRow(number, time, left, right, weight)

    def _number(self, time: int, period: float) -> int:
        number = 0
        if self._given is not None:
            before, since = self._given[0], time - self._given[1]
            step = round(since / period) if since > self._loss * period else 1
            number = before + step
            self.lost += step - 1
        self._given = number, time
        return number
