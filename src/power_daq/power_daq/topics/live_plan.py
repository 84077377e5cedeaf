"""An import plan carried out on messages as they arrive."""

from collections import deque
from collections.abc import Mapping, Sequence
from math import prod
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from power_recordings.importing.convert import groups_of
from power_recordings.importing.derived import PositionRates
from power_recordings.importing.map_file import JOINT
from power_recordings.importing.plan import ImportPlan, LogChannel

from power_daq.acquisition.receiver import Sample
from power_daq.acquisition.stream_merger import MergedRow, StreamMerger
from power_daq.bus.description import DEVICE_ERROR, STALE
from power_daq.topics.message_fields import MessageField

Floats = NDArray[np.float64]
_NOMINAL = 200_000_000  # ns, period of a topic until it is known
_BACK = 1_000_000_000  # ns; stamps that go back by more begin anew, as of a bag played again
ROWS: Final[Mapping[str, tuple[str, ...]]] = {
    'joint_states': JOINT,
    'joint_commands': ('command',),
    'drive_supply': ('voltage', 'current', 'status', 'power', 'temperature'),
    'supply': ('voltage', 'current', 'power'),
}


class _Stream:
    """The channels of a group that one topic carries."""

    def __init__(self, channels: Sequence[LogChannel]) -> None:
        self._sums = [
            [
                [MessageField(column.address.partition(':')[2]) for column in term]
                for term in c.terms
            ]
            for c in channels
        ]
        self._factors = np.array([c.conversion.factor for c in channels])
        self._offsets = np.array([c.conversion.offset for c in channels])
        self.unknown = np.full(len(channels), np.nan)

    def read(self, message: Any) -> Floats:
        """Return the converted values of a message; NaN where it has none."""
        values = [
            sum(prod(field.read(message) for field in term) for term in terms)
            for terms in self._sums
        ]
        return np.array(values) * self._factors + self._offsets


class LiveGroup:
    """
    The samples of one published topic: values [Q, D], Q as in ROWS, D its drives.

    Messages are merged on the times of the topic with the most of its signals, as an import does
    it. Values whose topic is silent are NaN; the status of electrical ones says so.
    """

    def __init__(self, name: str, plan: ImportPlan) -> None:
        self.name = name
        group = groups_of(plan)[name]
        self.drives = tuple(dict.fromkeys(drive for drive, _ in group.channels))
        self._rows = ROWS[name]
        self._shape = len(self._rows), len(self.drives)
        by_topic: dict[str, list[tuple[str, LogChannel]]] = {}
        for drive, channel in group.channels:
            if channel.stream is not None:
                by_topic.setdefault(channel.stream, []).append((drive, channel))
        self.topics = sorted(by_topic, key=lambda topic: -len(by_topic[topic]))
        members = [by_topic[topic] for topic in self.topics]
        self._streams = [_Stream([channel for _, channel in part]) for part in members]
        places = [self._place(drive, c.quantity) for part in members for drive, c in part]
        self._places = np.array(places, np.intp)
        self._slots = np.repeat(np.arange(len(members)), [len(part) for part in members])
        self._constants = np.full(self._shape, np.nan)
        for drive, channel in group.channels:
            if channel.stream is None:
                self._constants.flat[self._place(drive, channel.quantity)] = channel.constant()
        self._derived = [self._place(drive, 'velocity') for drive in group.derived]
        self._positions = [places.index(self._place(drive, 'position')) for drive in group.derived]
        self._last: dict[str, int] = {}
        self._first = self._lost = 0
        self.restarts = self.given = self.not_finite = 0
        self._begin()

    def _place(self, drive: str, quantity: str) -> int:
        return self._rows.index(quantity) * len(self.drives) + self.drives.index(drive)

    def _begin(self) -> None:
        streams = len(self._streams)
        self.merger: StreamMerger[Floats | None] = StreamMerger(streams, _NOMINAL, None)
        self._rates = PositionRates(self._positions) if self._positions else None
        self._numbers: deque[int] = deque()

    @property
    def lost(self) -> int:
        """Samples that did not come, by gaps in the times of the topic they are timed by."""
        return self._lost + self.merger.lost

    def lag(self, topic: str) -> float:
        """Return the time in s by which the newest stamp of a topic is behind that of all."""
        return (max(self._last.values(), default=0) - self._last.get(topic, 0)) / 1e9

    def take(self, topic: str, stamp: int, message: Any) -> list[Sample]:
        """Take a message of a topic with its stamp in ns; return the samples that are complete."""
        if topic not in self.topics:
            return []
        if stamp < self._last.get(topic, stamp) - _BACK:
            self.restarts += 1
            self._lost += self.merger.lost
            self._first += self.merger.count
            self._last.clear()
            self._begin()
        self._last[topic] = stamp
        slot = self.topics.index(topic)
        samples = []
        for row in self.merger.add(slot, stamp, self._streams[slot].read(message)):
            samples += self._samples(row)
        self.given += len(samples)
        return samples

    def _samples(self, row: MergedRow[Floats | None]) -> list[Sample]:
        weight = np.array(row.weight)[self._slots]
        left, right = self._flat(row.left), self._flat(row.right)
        with np.errstate(invalid='ignore'):
            values = np.where(weight == 1.0, right, left + weight * (right - left))
        stale = np.isnan(weight)
        self.not_finite += bool((~np.isfinite(values) & ~stale).any())
        number = self._first + row.number
        if self._rates is None:
            table = self._table(values)
            if 'status' in self._rows:
                self._flag(table, stale)
            return [Sample(self.name, number, row.time, row.time, table)]
        self._numbers.append(number)
        stamps, rows = self._rates.extend(np.array([row.time]), values[None], final=False)
        return [
            Sample(self.name, self._numbers.popleft(), time, time, self._table(numbers))
            for time, numbers in zip(stamps.tolist(), rows, strict=True)
        ]

    def _flat(self, rows: list[Floats | None]) -> Floats:
        streams = zip(rows, self._streams, strict=True)
        return np.concatenate([s.unknown if row is None else row for row, s in streams])

    def _table(self, values: Floats) -> Floats:
        """Return values [Q, D] of those read and constants; velocities derived come last."""
        table = self._constants.copy()
        table.flat[[*self._places, *self._derived]] = values
        if 'power' in self._rows:
            if self.name == 'supply':
                table[0] = np.where(np.isnan(table[0]), 1.0, table[0])
            power = table[self._rows.index('power')]
            with np.errstate(divide='ignore', invalid='ignore'):
                table[1] = np.where(np.isnan(table[1]), power / table[0], table[1])
        return table

    def _flag(self, table: Floats, stale: NDArray[np.bool_]) -> None:
        late = np.zeros(self._shape, bool)
        late.flat[self._places] = stale
        is_late = late[: self._rows.index('temperature')].any(axis=0)
        wrong = ~np.isfinite(table[0] * table[1])
        table[2] = np.where(is_late, STALE, np.where(wrong, DEVICE_ERROR, 0))
