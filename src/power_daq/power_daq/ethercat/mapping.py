"""The YAML file that says which channel of which terminal measures what of which drive."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from wattwalk_core.yaml_entry import Entry, read_entry

from power_daq.ethercat.terminals import TYPES, TerminalType

_TOP = ('device', 'cycle', 'frame_timeout', 'segment', 'electrical')
_CHANNEL = ('terminal', 'channel', 'ratio', 'offset')


@dataclass(frozen=True)
class ChannelMapping:
    """Quantity = ratio · V at the terminal + offset; ratio in V/V or A/V, offset in V or A."""

    terminal: int
    channel: int
    ratio: float
    offset: float = 0.0


@dataclass(frozen=True)
class DriveMapping:
    """Where voltage and current of a drive are measured."""

    drive: str
    voltage: ChannelMapping
    current: ChannelMapping


@dataclass(frozen=True)
class SegmentMapping:
    """
    The whole file.

    cycle: s between frames; frame_timeout: s until one counts as lost; segment: what must be on
    the cable, in its order from the master on; device: frame_id of drive_supply.
    """

    path: Path
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
        """Voltages of all drives, then their currents."""
        yield from (entry.voltage for entry in self.drives)
        yield from (entry.current for entry in self.drives)

    @classmethod
    def load(cls, path: Path) -> 'SegmentMapping':
        """Read and check a file; InputError names the file, the entry and what is wrong."""
        entry = read_entry(path, 'mapping')
        entry.allow(_TOP)
        segment = tuple(_terminal(row) for row in entry.rows('segment'))
        electrical = entry.child('electrical')
        electrical.allow(('drives',))
        drives: dict[str, DriveMapping] = {}
        used: dict[tuple[int, int], tuple[str, str]] = {}
        for row in electrical.rows('drives'):
            row.allow(('drive', 'voltage', 'current'))
            name = row.text('drive')
            if name in drives:
                raise row.error(f'drive {name!r} is there twice')
            voltage = _channel(row.child('voltage'), segment)
            current = _channel(row.child('current'), segment)
            _claim(used, row.child('voltage'), voltage, 'voltage', name)
            _claim(used, row.child('current'), current, 'current', name)
            drives[name] = DriveMapping(name, voltage, current)
        return cls(
            path,
            entry.text('device') if 'device' in entry else path.stem,
            entry.number('cycle', 250e-6, 0.1, 's', 1e-3),
            entry.number('frame_timeout', 100e-6, 1.0, 's', 2e-3),
            segment,
            tuple(drives.values()),
        )


def _claim(
    used: dict[tuple[int, int], tuple[str, str]],
    entry: Entry,
    place: ChannelMapping,
    quantity: str,
    drive: str,
) -> None:
    """Refuse a channel that is already something else; drives may share a voltage."""
    key = place.terminal, place.channel
    before = used.setdefault(key, (quantity, drive))
    if before != (quantity, drive) and not before[0] == quantity == 'voltage':
        raise entry.error(
            f'channel {place.channel} of terminal {place.terminal} is already the {before[0]} '
            f'of {before[1]}'
        )


def _terminal(row: Entry) -> TerminalType:
    kind = TYPES.get(row.value) if isinstance(row.value, str) else None
    if kind is None:
        raise row.error(f'unknown terminal {row.value!r}; there are {", ".join(TYPES)}')
    return kind


def _channel(entry: Entry, segment: tuple[TerminalType, ...]) -> ChannelMapping:
    entry.allow(_CHANNEL)
    terminal = entry.whole('terminal', 0, len(segment) - 1)
    kind = segment[terminal]
    if not kind.channels:
        raise entry.child('terminal').error(f'{kind.name} at {terminal} measures nothing')
    channel = entry.whole('channel', 1, kind.channels)
    ratio = entry.number('ratio', -1e4, 1e4, 'per V')
    if ratio == 0.0:
        raise entry.child('ratio').error('expected a number other than 0, there is 0')
    return ChannelMapping(terminal, channel, ratio, entry.number('offset', -1e3, 1e3, '', 0.0))
