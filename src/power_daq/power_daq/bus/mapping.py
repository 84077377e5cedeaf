"""The YAML file that assigns signals of a DBC to quantities of drives."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from wattwalk_core.errors import InputError
from wattwalk_core.quoting import quoted
from wattwalk_core.schema import Length, Name, Quantity, read, schema

REQUIRED: Mapping[str, tuple[str, ...]] = {
    'electrical': ('voltage', 'current'),
    'joints': ('position', 'velocity', 'torque'),
    'temperature': ('temperature',),
}
OPTIONAL: Mapping[str, tuple[str, ...]] = {'electrical': ('status',)}
_listed = ', '.join


@schema
class _Sync:
    message: Name
    time: Name
    counter: Name
    clock: Name = 'device'


@schema
class _Frame(_Sync):
    drives: Annotated[tuple[dict[str, Name], ...], Length(1)] = field(kw_only=True)


@schema
class _Group:
    rate: Annotated[float, Quantity(0.1, 10_000, 'Hz')]
    frames: Annotated[tuple[_Frame, ...], Length(1)]


@schema
class _File:
    device: Name | None = None
    sync: _Sync | None = None
    electrical: _Group | None = None
    joints: _Group | None = None
    temperature: _Group | None = None


@dataclass(frozen=True)
class FrameMapping:
    """A frame of a group: message, clock, counter and signals[drive][quantity]."""

    where: str
    message: str
    time: str
    counter: str
    clock: str
    signals: Mapping[str, Mapping[str, str]] = field(default_factory=dict)

    def quantities(self) -> Iterator[tuple[str, str, str]]:
        """Yield each (drive, quantity, signal) in the order of the file."""
        for drive, quantities in self.signals.items():
            for quantity, signal in quantities.items():
                yield drive, quantity, signal


@dataclass(frozen=True)
class GroupMapping:
    """Frames that make up one sample of drives, at a nominal rate in Hz."""

    name: str
    rate: float
    frames: tuple[FrameMapping, ...]

    @property
    def drives(self) -> tuple[str, ...]:
        """Drives in the order in which they first appear."""
        return tuple(dict.fromkeys(drive for f in self.frames for drive in f.signals))


@dataclass(frozen=True)
class BusMapping:
    """Content of the file; groups are some of electrical, joints and temperature."""

    path: Path
    device: str
    sync: FrameMapping | None
    groups: Mapping[str, GroupMapping]

    @property
    def drives(self) -> tuple[str, ...]:
        """Drives of all groups in the order in which they first appear."""
        return tuple(dict.fromkeys(d for group in self.groups.values() for d in group.drives))


def load_mapping(path: Path) -> BusMapping:
    """Read and check a mapping; InputError names the file, the entry and the reason."""
    file = read(_File, path, 'mapping')
    groups = {
        name: _group(f'{path}: {name}', name, group)
        for name in REQUIRED
        if (group := getattr(file, name)) is not None
    }
    if not groups:
        raise InputError(f'mapping {path}: maps nothing; give at least one of {_listed(REQUIRED)}')
    sync = None if file.sync is None else FrameMapping(f'{path}: sync', **vars(file.sync))
    return BusMapping(path, file.device or path.stem, sync, groups)


def _group(where: str, name: str, group: _Group) -> GroupMapping:
    frames = [
        FrameMapping(
            place := f'{where}.frames[{index}]',
            frame.message,
            frame.time,
            frame.counter,
            frame.clock,
            _signals(place, name, frame),
        )
        for index, frame in enumerate(group.frames)
    ]
    found = GroupMapping(name, group.rate, tuple(frames))
    _check_complete(found, where)
    return found


def _signals(where: str, group: str, frame: _Frame) -> Mapping[str, Mapping[str, str]]:
    """Signal by drive and quantity; InputError for a drive that is there twice, and the like."""
    known = ('drive', *REQUIRED[group], *OPTIONAL.get(group, ()))
    signals: dict[str, dict[str, str]] = {}
    for index, row in enumerate(frame.drives):
        place = f'mapping {where}.drives[{index}]'
        if 'drive' not in row:
            raise InputError(f"{place}: 'drive' is missing; there is {_listed(row) or 'nothing'}")
        if unknown := [key for key in row if key not in known]:
            raise InputError(
                f'{place}: unknown key {quoted(unknown[0])}; there can be {_listed(known)}'
            )
        drive = row['drive']
        if drive in signals:
            raise InputError(f'{place}: drive {drive!r} is there twice')
        signals[drive] = {key: row[key] for key in known[1:] if key in row}
        if not signals[drive]:
            raise InputError(
                f'{place}: no signal for {drive!r}; give some of {_listed(known[1:])}'
            )
    return signals


def _check_complete(group: GroupMapping, where: str) -> None:
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
                there = _listed(q for d, q in seen if d == drive)
                raise InputError(
                    f'mapping {where}: drive {drive!r} has no {quantity!r}; there is {there}'
                )
