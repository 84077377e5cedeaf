"""The YAML file that assigns signals of a DBC to quantities of drives."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from wattwalk_core.errors import InputError, quoted
from wattwalk_core.schema import Length, Name, Quantity, parse, read, schema

REQUIRED: Mapping[str, tuple[str, ...]] = {
    'electrical': ('voltage', 'current'),
    'joints': ('position', 'velocity', 'torque'),
    'temperature': ('temperature',),
}
OPTIONAL: Mapping[str, tuple[str, ...]] = {'electrical': ('status', 'power')}
EACH = '*'
_listed = ', '.join


@schema
class _Sync:
    message: Name
    time: Name
    counter: Name
    clock: Name = 'device'


@schema
class _Frame:
    message: Name
    time: Name | None = None
    counter: Name | None = None
    clock: Name = 'device'
    drives: Annotated[tuple[dict[str, Any], ...], Length(1)] = field(kw_only=True)

    def __post_init__(self) -> None:
        there = [name for name in ('time', 'counter') if getattr(self, name)]
        if len(there) == 1:
            other = 'counter' if there == ['time'] else 'time'
            raise InputError(
                f'{other!r} is missing; there is {there[0]!r}: give both, or neither where the '
                'device sends none and frames are stamped on receipt'
            )


@schema
class _Group:
    rate: Annotated[float, Quantity(0.1, 10_000, 'Hz')]
    frames: Annotated[tuple[_Frame, ...], Length(1)]


@schema
class NodeNumbers:
    """Numbers of the nodes on a bus of one drive a node, by drive.

    A frame's identifier is the node's number, shifted left by `shift` bits, or'ed with the one in
    the DBC.
    """

    shift: Annotated[int, Quantity(1, 20, 'bit')]
    drives: dict[Name, Annotated[int, Quantity(0, 0xFFFFF)]]
    most: Annotated[int, Quantity(0, 0xFFFFF)] = 0xFFFFF
    least: Annotated[int, Quantity(0, 0xFFFFF)] = 0

    def __post_init__(self) -> None:
        if not self.drives:
            raise InputError('drives: expected at least one drive')
        taken: dict[int, str] = {}
        for drive, node in self.drives.items():
            if not self.least <= node <= self.most:
                raise InputError(
                    f'drives.{drive}: expected a node from {self.least} to {self.most}, there is '
                    f'{node}'
                )
            if taken.setdefault(node, drive) != drive:
                raise InputError(f'drives: node {node} is both {taken[node]!r} and {drive!r}')


@schema
class _File:
    device: Name | None = None
    nodes: NodeNumbers | None = None
    poll: Literal['moteus'] | None = None
    sync: _Sync | None = None
    electrical: _Group | None = None
    joints: _Group | None = None
    temperature: _Group | None = None


@schema
class BusSignal:
    """One quantity of a drive: the signal of the DBC (`from` in the file) and its meaning.

    unit: instead of that in the DBC. A value is multiplied by `scale` in place of the conversion
    of its unit. positive: the sign of power that the drive draws. at: torque at the joint, or of
    the motor, computed from its current.
    """

    source: Name
    unit: str = ''
    scale: Annotated[float, Quantity(-1e12, 1e12)] | None = None
    positive: Literal['drawn', 'fed'] = 'drawn'
    at: Literal['joint', 'motor', ''] = ''

    def __post_init__(self) -> None:
        if self.scale == 0:
            raise InputError('scale: expected a number other than 0')


@dataclass(frozen=True)
class FrameMapping:
    """A frame of a group: message, clock, counter and signals[drive][quantity].

    time and counter are None where the device sends none. node: number and drive of the node that
    sends it, None on a bus whose DBC has all identifiers.
    """

    where: str  # place in the file, for errors
    message: str
    time: str | None
    counter: str | None
    clock: str
    signals: Mapping[str, Mapping[str, BusSignal]] = field(default_factory=dict)
    node: tuple[int, str] | None = None

    def quantities(self) -> Iterator[tuple[str, str, BusSignal]]:
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
    """Content of a mapping file; groups are some of electrical, joints and temperature.

    poll: protocol of queries that the nodes answer; None where devices send by themselves.
    """

    path: Path
    device: str
    sync: FrameMapping | None
    groups: Mapping[str, GroupMapping]
    nodes: NodeNumbers | None = None
    poll: str | None = None

    @property
    def drives(self) -> tuple[str, ...]:
        """Drives of all groups in the order in which they first appear."""
        return tuple(dict.fromkeys(d for group in self.groups.values() for d in group.drives))


def load_mapping(path: Path, nodes: Mapping[str, int] | None = None) -> BusMapping:
    """Read and check a mapping; InputError names the file, the entry and the reason.

    nodes: numbers of the nodes by drive, instead of those in the file.
    """
    file = read(_File, path, 'mapping')
    numbers = file.nodes
    if nodes:
        if numbers is None:
            raise InputError(f'mapping {path}: has no nodes, so drives cannot be given numbers')
        try:
            numbers = replace(numbers, drives=dict(nodes))
        except InputError as error:
            raise InputError(f'nodes: {error}') from None
    if file.poll is not None and numbers is None:
        raise InputError(f'mapping {path}: poll needs nodes, to which queries go')
    groups = {
        name: _group(f'{path}: {name}', name, group, numbers)
        for name in REQUIRED
        if (group := getattr(file, name)) is not None
    }
    if not groups:
        raise InputError(f'mapping {path}: maps nothing; give at least one of {_listed(REQUIRED)}')
    sync = None if file.sync is None else FrameMapping(f'{path}: sync', **vars(file.sync))
    return BusMapping(path, file.device or path.stem, sync, groups, numbers, file.poll)


def _group(where: str, name: str, group: _Group, nodes: NodeNumbers | None) -> GroupMapping:
    frames: list[FrameMapping] = []
    for index, frame in enumerate(group.frames):
        place = f'{where}.frames[{index}]'
        signals = _signals(place, name, frame)
        entry = FrameMapping(place, frame.message, frame.time, frame.counter, frame.clock, signals)
        frames += [entry] if EACH not in signals else _of_each_node(entry, nodes)
    if len({frame.counter is None for frame in frames}) > 1:
        raise InputError(
            f"mapping {where}: some frames have 'time' and 'counter' and some have not; a sample "
            'is put together by counters or by the times of receipt'
        )
    found = GroupMapping(name, group.rate, tuple(frames))
    _check_complete(found, where)
    return found


def _of_each_node(entry: FrameMapping, nodes: NodeNumbers | None) -> list[FrameMapping]:
    """Return the frame of a drive `*` for each node, named by its drive."""
    if nodes is None:
        raise InputError(f"mapping {entry.where}: drive '*' needs nodes, each with its drive")
    if len(entry.signals) > 1:
        raise InputError(f"mapping {entry.where}: drive '*' stands beside other drives")
    return [
        replace(entry, signals={drive: entry.signals[EACH]}, node=(number, drive))
        for drive, number in nodes.drives.items()
    ]


def _signals(where: str, group: str, frame: _Frame) -> Mapping[str, Mapping[str, BusSignal]]:
    """Signal by drive and quantity; InputError for a drive that is there twice, and the like."""
    known = ('drive', *REQUIRED[group], *OPTIONAL.get(group, ()))
    signals: dict[str, dict[str, BusSignal]] = {}
    for index, row in enumerate(frame.drives):
        place = f'mapping {where}.drives[{index}]'
        if 'drive' not in row:
            raise InputError(f"{place}: 'drive' is missing; there is {_listed(row) or 'nothing'}")
        if unknown := [key for key in row if key not in known]:
            raise InputError(
                f'{place}: unknown key {quoted(unknown[0])}; there can be {_listed(known)}'
            )
        drive = parse(Name, row['drive'], f'{place}.drive')  # type: ignore[arg-type]
        if drive in signals:
            raise InputError(f'{place}: drive {drive!r} is there twice')
        signals[drive] = {
            key: _signal(row[key], key, f'{place}.{key}') for key in known[1:] if key in row
        }
        if not signals[drive]:
            raise InputError(
                f'{place}: no signal for {drive!r}; give some of {_listed(known[1:])}'
            )
    return signals


def _signal(entry: object, quantity: str, where: str) -> BusSignal:
    """Return the signal of an entry, a name or a name with its meaning."""
    if isinstance(entry, dict):
        entry = {'source' if key == 'from' else key: value for key, value in entry.items()}
    else:
        entry = {'source': parse(Name, entry, where)}  # type: ignore[arg-type]
    signal = parse(BusSignal, entry, where)
    if signal.at and quantity != 'torque':
        raise InputError(f"{where}: 'at' is of a torque, not of a {quantity}")
    return signal


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
        there = [quantity for name, quantity in seen if name == drive]
        if {'power', 'current'} <= {*there}:
            raise InputError(f'mapping {where}: drive {drive!r}: give current or power, not both')
        given = [*there, 'current'] if 'power' in there else there
        for quantity in REQUIRED[group.name]:
            if quantity not in given:
                raise InputError(
                    f'mapping {where}: drive {drive!r} has no {quantity!r}; there is '
                    f'{_listed(there)}'
                )
