"""The YAML file that says which signals of a DBC are which quantities of which drives."""

from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from power_daq.cli import InputError

REQUIRED: Mapping[str, tuple[str, ...]] = {
    'electrical': ('voltage', 'current'),
    'joints': ('position', 'velocity', 'torque'),
    'temperature': ('temperature',),
}
OPTIONAL: Mapping[str, tuple[str, ...]] = {'electrical': ('status',)}
_TOP = ('device', 'sync', *REQUIRED)


@dataclass(frozen=True)
class FrameMapping:
    """One frame of a group: its message, clock and counter, and signals[drive][quantity]."""

    where: str
    message: str
    time: str
    counter: str
    clock: str = 'device'
    signals: Mapping[str, Mapping[str, str]] | None = None

    def quantities(self) -> Iterator[tuple[str, str, str]]:
        """Each (drive, quantity, signal) in the order of the file."""
        for drive, quantities in (self.signals or {}).items():
            for quantity, signal in quantities.items():
                yield drive, quantity, signal


@dataclass(frozen=True)
class GroupMapping:
    """Frames that together are one sample of drives, at a nominal rate in Hz."""

    name: str
    rate: float
    frames: tuple[FrameMapping, ...]

    @property
    def drives(self) -> tuple[str, ...]:
        """Drives in the order in which they first appear."""
        return tuple(dict.fromkeys(drive for f in self.frames for drive in f.signals or ()))


@dataclass(frozen=True)
class BusMapping:
    """The whole file; groups are some of electrical, joints and temperature."""

    path: Path
    device: str
    sync: FrameMapping | None
    groups: Mapping[str, GroupMapping]

    @property
    def drives(self) -> tuple[str, ...]:
        """Drives of all groups in the order in which they first appear."""
        return tuple(dict.fromkeys(d for group in self.groups.values() for d in group.drives))


def load_mapping(path: Path) -> BusMapping:
    """Read and check a mapping; InputError names the file, the entry and what is wrong."""
    entry = _Entry(str(path), _read(path))
    entry.allow(_TOP)
    groups = {name: _group(name, entry.child(name)) for name in REQUIRED if name in entry}
    if not groups:
        raise entry.error(f'maps nothing; give at least one of {", ".join(REQUIRED)}')
    sync = None
    if 'sync' in entry:
        sync = _frame(entry.child('sync'), 'sync', with_drives=False)
    device = entry.text('device') if 'device' in entry else path.stem
    return BusMapping(path, device, sync, groups)


class _UniqueKeys(yaml.SafeLoader):
    """YAML in which a repeated key is an error instead of the last one winning."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        keys = [self.construct_object(key, deep=True) for key, _ in node.value]
        for key in keys:
            if keys.count(key) > 1:
                mark = node.start_mark
                raise yaml.constructor.ConstructorError(
                    'a mapping', mark, f'key {key!r} is there twice', mark
                )
        return super().construct_mapping(node, deep)


def _read(path: Path) -> Any:
    try:
        with path.open(encoding='utf-8') as file:
            return yaml.load(file, _UniqueKeys)
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f'cannot read mapping {path}: {error}') from error
    except yaml.YAMLError as error:
        reason = ' '.join(str(error).split())
        raise InputError(f'mapping {path} is no valid YAML: {reason}') from error


@dataclass(frozen=True)
class _Entry:
    """A value of the file with its place, for errors that name it."""

    where: str
    value: Any

    def error(self, text: str) -> InputError:
        return InputError(f'mapping {self.where}: {text}')

    def __contains__(self, key: str) -> bool:
        if not isinstance(self.value, dict):
            raise self.error(f'expected keys with values, there is {self.value!r}')
        return key in self.value

    def allow(self, keys: Sequence[str]) -> None:
        if not isinstance(self.value, dict):
            raise self.error(f'expected keys with values, there is {self.value!r}')
        unknown = [key for key in self.value if key not in keys]
        if unknown:
            raise self.error(f'unknown key {unknown[0]!r}; there can be {", ".join(keys)}')

    def child(self, key: str) -> '_Entry':
        if key not in self:
            there = ', '.join(map(str, self.value)) or 'nothing'
            raise self.error(f'{key!r} is missing; there is {there}')
        return _Entry(f'{self.where}: {key}', self.value[key])

    def text(self, key: str) -> str:
        value = self.child(key).value
        if not isinstance(value, str) or not value:
            raise self.child(key).error(f'expected a name, there is {value!r}')
        return value

    def rows(self, key: str) -> Iterator['_Entry']:
        rows = self.child(key)
        if not isinstance(rows.value, list) or not rows.value:
            raise rows.error(f'expected a list, there is {rows.value!r}')
        for index, row in enumerate(rows.value):
            yield _Entry(f'{rows.where}[{index}]', row)


def _group(name: str, entry: _Entry) -> GroupMapping:
    entry.allow(('rate', 'frames'))
    rate = entry.child('rate')
    number = isinstance(rate.value, int | float) and not isinstance(rate.value, bool)
    if not number or not 0.1 <= rate.value <= 10_000:
        raise rate.error(f'expected 0.1 to 10000 Hz, there is {rate.value!r}')
    frames = tuple(_frame(row, name) for row in entry.rows('frames'))
    group = GroupMapping(name, float(rate.value), frames)
    _check_complete(group, entry)
    return group


def _frame(entry: _Entry, group: str, with_drives: bool = True) -> FrameMapping:
    entry.allow(('message', 'time', 'counter', 'clock', *(['drives'] if with_drives else [])))
    signals: dict[str, dict[str, str]] = {}
    if with_drives:
        quantities = REQUIRED[group] + OPTIONAL.get(group, ())
        for row in entry.rows('drives'):
            row.allow(('drive', *quantities))
            drive = row.text('drive')
            if drive in signals:
                raise row.error(f'drive {drive!r} is there twice')
            signals[drive] = {
                quantity: row.text(quantity) for quantity in quantities if quantity in row
            }
            if not signals[drive]:
                raise row.error(f'no signal for {drive!r}; give some of {", ".join(quantities)}')
    return FrameMapping(
        where=entry.where,
        message=entry.text('message'),
        time=entry.text('time'),
        counter=entry.text('counter'),
        clock=entry.text('clock') if 'clock' in entry else 'device',
        signals=signals,
    )


def _check_complete(group: GroupMapping, entry: _Entry) -> None:
    seen: dict[tuple[str, str], str] = {}
    for frame in group.frames:
        for drive, quantity, _ in frame.quantities():
            if (drive, quantity) in seen:
                raise InputError(
                    f'mapping {frame.where}: {quantity} of drive {drive!r} is there twice, '
                    f'also in message {seen[drive, quantity]!r}'
                )
            seen[drive, quantity] = frame.message
    for drive in group.drives:
        for quantity in REQUIRED[group.name]:
            if (drive, quantity) not in seen:
                there = ', '.join(q for d, q in seen if d == drive)
                raise entry.error(f'drive {drive!r} has no {quantity!r}; there is {there}')
