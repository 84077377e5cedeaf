"""The YAML file that says which signals of a DBC are which quantities of which drives."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from wattwalk_core.errors import InputError
from wattwalk_core.yaml_entry import Entry, read_entry

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
    entry = read_entry(path, 'mapping')
    entry.allow(_TOP)
    groups = {name: _group(name, entry.child(name)) for name in REQUIRED if name in entry}
    if not groups:
        raise entry.error(f'maps nothing; give at least one of {", ".join(REQUIRED)}')
    sync = None
    if 'sync' in entry:
        sync = _frame(entry.child('sync'), 'sync', with_drives=False)
    device = entry.text('device') if 'device' in entry else path.stem
    return BusMapping(path, device, sync, groups)


def _group(name: str, entry: Entry) -> GroupMapping:
    entry.allow(('rate', 'frames'))
    rate = entry.number('rate', 0.1, 10_000, 'Hz')
    frames = tuple(_frame(row, name) for row in entry.rows('frames'))
    group = GroupMapping(name, rate, frames)
    _check_complete(group, entry)
    return group


def _frame(entry: Entry, group: str, with_drives: bool = True) -> FrameMapping:
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


def _check_complete(group: GroupMapping, entry: Entry) -> None:
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
