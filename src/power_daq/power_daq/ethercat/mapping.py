"""The YAML file that assigns channels of EtherCAT terminals to quantities of drives."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from wattwalk_core.errors import InputError, quoted
from wattwalk_core.schema import Length, Name, Quantity, read, schema

from power_daq.ethercat.terminals import TYPES, TerminalType


@schema
class ChannelMapping:
    """Quantity = ratio · V at the terminal + offset; ratio in V/V or A/V, offset in V or A."""

    terminal: int
    channel: int
    ratio: Annotated[float, Quantity(-1e4, 1e4, 'per V')]
    offset: Annotated[float, Quantity(-1e3, 1e3)] = 0.0

    def __post_init__(self) -> None:
        if not self.ratio:
            raise ValueError('ratio: expected a number other than 0, there is 0')


@schema
class DriveMapping:
    """The channels that measure voltage and current of a drive."""

    drive: Name
    voltage: ChannelMapping
    current: ChannelMapping


@schema
class _Electrical:
    drives: Annotated[tuple[DriveMapping, ...], Length(1)]


@schema
class _File:
    segment: Annotated[tuple[Name, ...], Length(1)]
    electrical: _Electrical
    device: Name | None = None
    cycle: Annotated[float, Quantity(250e-6, 0.1, 's')] = 1e-3
    frame_timeout: Annotated[float, Quantity(100e-6, 1.0, 's')] = 2e-3


@dataclass(frozen=True)
class SegmentMapping:
    """Content of a mapping file of EtherCAT terminals.

    cycle: s between frames; frame_timeout: s until one counts as lost; segment: the terminals on
    the cable in their order from the master on; device: frame_id of drive_supply.
    """

    device: str
    cycle: float
    frame_timeout: float
    segment: tuple[TerminalType, ...]
    drives: tuple[DriveMapping, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Drives in the order of the file."""
        return tuple(entry.drive for entry in self.drives)

    def channels(self) -> Iterator[ChannelMapping]:
        """Yield the channels of all voltages, then those of all currents."""
        yield from (entry.voltage for entry in self.drives)
        yield from (entry.current for entry in self.drives)

    @classmethod
    def load(cls, path: Path) -> 'SegmentMapping':
        """Read and check a file; InputError names the file, the entry and the reason."""
        file = read(_File, path, 'mapping')
        where = f'mapping {path}'
        for place, name in enumerate(file.segment):
            if name not in TYPES:
                raise InputError(
                    f'{where}: segment[{place}]: unknown terminal {quoted(name)}; '
                    f'there are {", ".join(TYPES)}'
                )
        segment = tuple(TYPES[name] for name in file.segment)
        drives = file.electrical.drives
        _check_channels(where, segment, drives)
        return cls(file.device or path.stem, file.cycle, file.frame_timeout, segment, drives)


def _check_channels(
    where: str, segment: tuple[TerminalType, ...], drives: tuple[DriveMapping, ...]
) -> None:
    """Refuse channels that do not exist or measure two things; drives may share a voltage."""
    names = [entry.drive for entry in drives]
    used: dict[tuple[int, int], tuple[str, str]] = {}
    for index, entry in enumerate(drives):
        row = f'{where}: electrical.drives[{index}]'
        if entry.drive in names[:index]:
            raise InputError(f'{row}: drive {entry.drive!r} is there twice')
        for quantity, place in (('voltage', entry.voltage), ('current', entry.current)):
            if wrong := _wrong(place, segment):
                raise InputError(f'{row}.{quantity}.{wrong}')
            key = place.terminal, place.channel
            before = used.setdefault(key, (quantity, entry.drive))
            if before != (quantity, entry.drive) and not before[0] == quantity == 'voltage':
                raise InputError(
                    f'{row}.{quantity}: channel {place.channel} of terminal {place.terminal} is '
                    f'already the {before[0]} of {before[1]}'
                )


def _wrong(place: ChannelMapping, segment: tuple[TerminalType, ...]) -> str:
    """Return what the segment does not have of a terminal and channel, '' if it has both."""
    expected = '{}: expected a whole number from {} to {}, there is {}'
    if not 0 <= place.terminal < len(segment):
        return expected.format('terminal', 0, len(segment) - 1, place.terminal)
    kind = segment[place.terminal]
    if not kind.channels:
        return f'terminal: {kind.name} at {place.terminal} measures nothing'
    if not 1 <= place.channel <= kind.channels:
        return expected.format('channel', 1, kind.channels, place.channel)
    return ''
