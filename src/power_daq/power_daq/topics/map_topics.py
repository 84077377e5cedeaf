"""The topics that an import map reads, and those that are published from it."""

import re
from collections.abc import Iterable, Iterator

from power_recordings.importing.map_file import ImportMap, Signal
from wattwalk_core.errors import InputError
from wattwalk_core.quoting import quoted


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
