"""From the first messages of a robot's topics to samples of the suite's."""

import re
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice
from math import nan, prod
from typing import Any, Final

import numpy as np
from power_recordings.importing.channel_group import PositionRates
from power_recordings.importing.convert import groups_of
from power_recordings.importing.map_file import JOINT, ImportMap
from power_recordings.importing.plan import ImportPlan, LogChannel, ShaftPower, make_plan
from power_recordings.importing.sources.source import LogColumn
from wattwalk_core.arrays import Bools, Floats
from wattwalk_core.errors import InputError, quoted

from power_daq.acquisition.receiver import Sample
from power_daq.acquisition.stream_merger import MergedRow, StreamMerger
from power_daq.bus.description import DEVICE_ERROR, STALE

_MOST_COLUMNS = 400
_STEP = re.compile(r'\.?([^.\[\]]+)(?:\[([^\[\]]*)\])?')


class MessageField:
    """One number of a message: `field.path`, `array[3]`, `array[NAME]` or `array[3].field`.

    A name is looked up in the field `name` beside the array, as in sensor_msgs/JointState.
    """

    def __init__(self, path: str) -> None:
        self._steps = [(m[1], m[2]) for m in _STEP.finditer(path)]

    def read(self, message: Any) -> float:
        """Return the number; NaN where the message has none there."""
        for name, index in self._steps:
            parent, message = message, getattr(message, name, None)
            if index is not None:
                place = _place(parent, message, index)
                if place is None:
                    return nan
                message = message[place]
        return float(message) if isinstance(message, int | float) else nan


def _place(parent: Any, values: Any, index: str) -> int | None:
    """Return the place of an index or name in an array, None where it is not there."""
    if isinstance(values, str) or not hasattr(values, '__len__'):
        return None
    names = _names(parent, len(values))
    if index in names:
        return names.index(index)
    return int(index) if index.isdecimal() and int(index) < len(values) else None


def _names(parent: Any, count: int) -> Sequence[str]:
    """Return the names of an array's values, those of the field `name` beside it."""
    names = getattr(parent, 'name', ())
    is_named = isinstance(names, list | tuple) and len(names) == len(set(names)) == count
    return names if is_named and all(isinstance(name, str) for name in names) else ()


def columns_of(topic: str, message: Any) -> list[LogColumn]:
    """Return the first 400 numeric fields of a message as columns of a log."""
    return [
        LogColumn(f'{topic}:{path}', topic) for path in islice(_paths(message, ''), _MOST_COLUMNS)
    ]


def _paths(message: Any, prefix: str) -> Iterator[str]:
    for field in message.get_fields_and_field_types():
        value, path = getattr(message, field), f'{prefix}{field}'
        if isinstance(value, int | float):
            yield path
        elif hasattr(value, 'get_fields_and_field_types'):
            yield from () if path == 'header' else _paths(value, f'{path}.')
        elif not isinstance(value, str | bytes) and len(value):
            names = _names(message, len(value)) or range(len(value))
            if hasattr(value[0], 'get_fields_and_field_types'):
                for index, item in enumerate(value):
                    yield from _paths(item, f'{path}[{index}].')
            elif isinstance(value[0], int | float):
                yield from (f'{path}[{name}]' for name in names)


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
        self._shafts = [
            (place, c, {a: MessageField(a.partition(':')[2]) for a in c.addresses})
            for place, c in enumerate(channels)
            if isinstance(c, ShaftPower)
        ]

    def read(self, message: Any) -> Floats:
        """Return the converted values of a message; NaN where it has none."""
        values = [
            sum(prod(field.read(message) for field in term) for term in terms)
            for terms in self._sums
        ]
        converted = np.array(values) * self._factors + self._offsets
        for place, channel, fields in self._shafts:
            columns = {a: np.array([field.read(message)]) for a, field in fields.items()}
            converted[place] = channel.convert(columns)[0]
        return converted


class LiveGroup:
    """Samples of one published topic: values [Q, D], Q as in ROWS, D its drives.

    Messages are merged on the times of the topic with the most of its signals, as an import does
    it. Values whose topic no longer comes are NaN; the status of electrical ones says so.
    """

    def __init__(self, name: str, plan: ImportPlan) -> None:
        self.name = name
        group = groups_of(plan)[name]
        self.drives = tuple(dict.fromkeys(drive for drive, _ in group.channels))
        self._rows = ROWS[name]
        self._shape = len(self._rows), len(self.drives)
        self._constants = np.full(self._shape, np.nan)
        by_topic: dict[str, list[tuple[str, LogChannel]]] = {}
        for drive, channel in group.channels:
            if channel.stream is None:
                self._constants.flat[self._place(drive, channel.quantity)] = channel.constant()
            else:
                by_topic.setdefault(channel.stream, []).append((drive, channel))
        self.topics = sorted(by_topic, key=lambda topic: -len(by_topic[topic]))
        members = [by_topic[topic] for topic in self.topics]
        self._streams = [_Stream([channel for _, channel in part]) for part in members]
        places = [self._place(drive, c.quantity) for part in members for drive, c in part]
        self._places = np.array(places, np.intp)
        self._slots = np.repeat(np.arange(len(members)), [len(part) for part in members])
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
        rows = self.merger.add(slot, stamp, self._streams[slot].read(message))
        samples = [sample for row in rows for sample in self._samples(row)]
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

    def _flat(self, rows: Sequence[Floats | None]) -> Floats:
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

    def _flag(self, table: Floats, stale: Bools) -> None:
        late = np.zeros(self._shape, bool)
        late.flat[self._places] = stale
        is_late = late[: self._rows.index('temperature')].any(axis=0)
        wrong = ~np.isfinite(table[0] * table[1])
        table[2] = np.where(is_late, STALE, np.where(wrong, DEVICE_ERROR, 0))


class MapTopics:
    """Topics named by the signals of a map; a `*` in a name stands for any text without a slash.

    where: the name of the map, for errors. Raises InputError for a signal that names no topic.
    """

    def __init__(self, mapping: ImportMap, where: str) -> None:
        self._patterns: dict[str, re.Pattern[str]] = {}
        self._required: dict[str, None] = {}
        signals = {
            f'drives.{drive}.{quantity}': signal
            for drive, entry in mapping.drives.items()
            for quantity, signal in entry.signals().items()
        }
        supply = mapping.supply.signals()
        signals |= {f'supply.{quantity}': signal for quantity, signal in supply.items()}
        for place, signal in signals.items():
            if not signal.source:
                continue
            name, colon, field = signal.source.partition(':')
            if not colon or not name.startswith('/') or not field:
                raise InputError(
                    f'{where}: {place}: {quoted(signal.source)} names no topic; expected '
                    '/topic:field as in maps of bags'
                )
            text = '[^/]+?'.join(re.escape(part) for part in name.split('*'))
            self._patterns[name] = re.compile(text)
            if not signal.optional:
                self._required[name] = None
        self.outputs = ['joint_states']
        drives = [drive.signals() for drive in mapping.drives.values()]
        if any({'current', 'power', 'efficiency', 'loss'} & set(signals) for signals in drives):
            self.outputs.append('drive_supply')
        if supply:
            self.outputs.append('supply')
        self.has_commands = any('command' in signals for signals in drives)

    def matching(self, topics: Iterable[str]) -> list[str]:
        """Return those of the given topics that the map reads."""
        patterns = self._patterns.values()
        return [topic for topic in topics if any(p.fullmatch(topic) for p in patterns)]

    def awaited(self, heard: Iterable[str]) -> list[str]:
        """Return the names, as in the map, of which no topic is among those heard."""
        topics, patterns = list(heard), self._patterns
        return [name for name in self._required if not any(map(patterns[name].fullmatch, topics))]


_S = 1_000_000_000


class Republisher:
    """Samples by published topic, once every topic that the map needs has had a message.

    where: the name of the map, for errors. `take` raises InputError for messages that do not have
    what the map names, or no stamp where the map wants one.
    """

    def __init__(self, mapping: ImportMap, where: str, *, commands: bool = False) -> None:
        self.topics = MapTopics(mapping, where)
        self._mapping, self._where, self._commands = mapping, where, commands
        self._first: dict[str, Any] = {}
        self.heard: Counter[str] = Counter()
        self.plan: ImportPlan | None = None
        self.groups: dict[str, LiveGroup] = {}
        self._inputs: tuple[str, ...] = ()

    @property
    def awaited(self) -> list[str]:
        """Topics of the map of which no message has come; empty once samples do."""
        return [] if self.plan is not None else self.topics.awaited(self.heard)

    def is_left_out(self, topic: str) -> bool:
        """Return whether a topic of the map came too late for its drives to be known."""
        return self.plan is not None and topic not in self._inputs

    def begin(self) -> Mapping[str, LiveGroup]:
        """Fix drives and signals by the first messages; return the groups by published topic."""
        columns = [c for topic, message in self._first.items() for c in columns_of(topic, message)]
        self.plan = make_plan(self._mapping, columns, self._where, is_bag=True)
        self._inputs = tuple(self._first)
        self._first.clear()
        has_commands = self._commands and self.topics.has_commands
        for name in self.topics.outputs + ['joint_commands'] * has_commands:
            self.groups[name] = LiveGroup(name, self.plan)
        return self.groups

    def take(self, topic: str, arrival: int, message: Any) -> list[Sample]:
        """Take a message that arrived at a ROS time in ns; return the complete samples."""
        self.heard[topic] += 1
        if self.plan is None:
            self._first.setdefault(topic, message)
            return []
        stamp = arrival if self._mapping.stamp == 'log' else self._header(topic, message)
        groups = self.groups.values()
        return [sample for group in groups for sample in group.take(topic, stamp, message)]

    def _header(self, topic: str, message: Any) -> int:
        stamp = getattr(getattr(message, 'header', None), 'stamp', None)
        nanoseconds = 0 if stamp is None else int(stamp.sec) * _S + int(stamp.nanosec)
        if not nanoseconds:
            raise InputError(
                f'{self._where}: the messages of {topic} have no time of their own; use '
                'time: {stamp: log} in the map'
            )
        return nanoseconds
