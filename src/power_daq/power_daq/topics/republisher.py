"""From the first messages of a robot's topics to samples of the suite's."""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from power_recordings.importing.map_file import ImportMap, Signal
from power_recordings.importing.plan import ImportPlan, make_plan
from wattwalk_core.errors import InputError
from wattwalk_core.quoting import quoted

from power_daq.acquisition.receiver import Sample
from power_daq.topics.live_plan import LiveGroup
from power_daq.topics.message_fields import columns_of


class MapTopics:
    """
    Topics named by the signals of a map; a `*` in a name stands for any text without a slash.

    where: the name of the map, for errors. Raises InputError for a signal that names no topic.
    """

    def __init__(self, mapping: ImportMap, where: str) -> None:
        self._required: dict[str, re.Pattern[str]] = {}
        self._optional: dict[str, re.Pattern[str]] = {}
        for place, signal in _signals(mapping):
            if not signal.source:
                continue
            name, colon, field = signal.source.partition(':')
            if not colon or not name.startswith('/') or not field:
                raise InputError(
                    f'{where}: {place}: {quoted(signal.source)} names no topic; expected '
                    '/topic:field as in maps of bags'
                )
            kind = self._optional if signal.optional else self._required
            text = '[^/]+?'.join(re.escape(part) for part in name.split('*'))
            kind[name] = re.compile(text)
        self.outputs = ['joint_states']
        drives = [drive.signals() for drive in mapping.drives.values()]
        if any({'current', 'power'} & set(signals) for signals in drives):
            self.outputs.append('drive_supply')
        if mapping.supply.signals():
            self.outputs.append('supply')
        self.has_commands = any('command' in signals for signals in drives)

    def matching(self, topics: Iterable[str]) -> list[str]:
        """Return those of some topics that the map reads."""
        patterns = [*self._required.values(), *self._optional.values()]
        return [topic for topic in topics if any(p.fullmatch(topic) for p in patterns)]

    def awaited(self, heard: Iterable[str]) -> list[str]:
        """Return the names, as in the map, of which no topic is among those heard."""
        topics = list(heard)
        return [
            name
            for name, pattern in self._required.items()
            if not any(pattern.fullmatch(topic) for topic in topics)
        ]


def _signals(mapping: ImportMap) -> Iterator[tuple[str, Signal]]:
    for drive, entry in mapping.drives.items():
        for quantity, signal in entry.signals().items():
            yield f'drives.{drive}.{quantity}', signal
    for quantity, signal in mapping.supply.signals().items():
        yield f'supply.{quantity}', signal


_S = 1_000_000_000


class Republisher:
    """
    Samples by published topic, once every topic that the map needs has had a message.

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
        wanted = self.topics.outputs + ['joint_commands'] * self._commands
        for name in wanted:
            if name != 'joint_commands' or self.topics.has_commands:
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
