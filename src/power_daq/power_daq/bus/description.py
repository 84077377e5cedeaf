"""Description of the bus of a robot: a DBC and the mapping of its signals to drives."""

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path

import can
import cantools
import numpy as np
from cantools.database.can.database import Database
from numpy.typing import ArrayLike
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError, quoted

from power_daq.bus.frame import Frame, FrameGroup
from power_daq.bus.mapping import REQUIRED, BusMapping, load_mapping
from power_daq.bus.moteus import REGISTERS, MoteusRegisters
from power_daq.bus.signal_layout import SignalLayout

_FOLDER = Path(__file__).parent
DEFAULT_DBC = _FOLDER / 'drives.dbc'
DEFAULT_MAPPING = _FOLDER / 'anymal.yaml'
READY = ('odrive', 'moteus')
UNDERRANGE, OVERRANGE, DEVICE_ERROR, STALE = 1, 2, 4, 8


class BusDescription:
    """Encodes and decodes the frames of a bus; D is the number of drives that it names.

    Encoding is for simulated hardware. Voltages are in V, currents in A and positive while the
    drive draws, positions in rad, velocities in rad/s, torques in N·m, temperatures in °C.
    """

    def __init__(self, database: Database, mapping: BusMapping) -> None:
        self.device = mapping.device
        self.drives = mapping.drives
        self.groups: Mapping[str, FrameGroup] = {
            name: FrameGroup(group, database, self.drives, mapping.nodes)
            for name, group in mapping.groups.items()
        }
        self.nodes = mapping.nodes
        self.polled = None if mapping.poll is None else self._polled(mapping)
        joints = self.groups.get('joints')
        # `joint` or `motor` by drive, as far as the mapping says it; A where it is a current.
        self.torque_at: Mapping[str, str] = {} if joints is None else joints.torque_at
        self.torque_unit: Mapping[str, str] = {} if joints is None else joints.torque_unit
        self._sync: Frame | None = None
        if mapping.sync is not None:
            self._sync = Frame(database, mapping.sync, None, 'sync', 0)
        self.is_fd = any(message.is_fd for message in database.messages)
        self.known = frozenset(self._known(database))
        self.clocks = self._clocks(mapping)

    @classmethod
    def load(
        cls,
        dbc: Path | None = None,
        mapping: Path | None = None,
        nodes: Mapping[str, int] | None = None,
    ) -> 'BusDescription':
        """Read both files; the defaults are the shipped ones, of an ANYmal's twelve drives.

        nodes: numbers of the nodes by drive, instead of those in the mapping. Raises InputError
        for a file that cannot be read or names a message or signal that the DBC does not have.
        """
        database = load_database(DEFAULT_DBC if dbc is None else dbc)
        path = DEFAULT_MAPPING if mapping is None else mapping
        return cls(database, load_mapping(path, nodes))

    @classmethod
    def ready(
        cls, name: str, mapping: Path | None = None, nodes: Mapping[str, int] | None = None
    ) -> 'BusDescription':
        """Read a shipped description, odrive or moteus; InputError for another name.

        mapping, nodes: in place of those shipped.
        """
        if name not in READY:
            raise InputError(f'no bus {quoted(name)}: expected one of {", ".join(READY)}')
        return cls.load(_FOLDER / f'{name}.dbc', mapping or _FOLDER / f'{name}.yaml', nodes)

    def _polled(self, mapping: BusMapping) -> MoteusRegisters:
        """Return queries for the mapped registers; their replies go to the DBC's identifier."""
        assert mapping.nodes is not None
        entries = [entry for group in mapping.groups.values() for entry in group.frames]
        names = [signal.source for entry in entries for _, _, signal in entry.quantities()]
        if unknown := sorted(set(names) - REGISTERS.keys()):
            raise InputError(
                f'mapping {mapping.path}: {quoted(unknown[0])} is no register of moteus that can '
                f'be polled; there are {", ".join(REGISTERS)}'
            )
        frames = [frame for group in self.groups.values() for frame in group.frames]
        hosts = sorted({frame.message.frame_id for frame in frames})
        return MoteusRegisters(names, mapping.nodes.drives, hosts[0])

    @property
    def rate(self) -> float:
        """Highest rate of the groups, Hz."""
        return max(group.rate for group in self.groups.values())

    def _known(self, database: Database) -> Iterator[int]:
        nodes = self.nodes
        shift, numbers = (0, [0]) if nodes is None else (nodes.shift, nodes.drives.values())
        for message in database.messages:
            for number in numbers:
                identifier = message.frame_id | number << shift
                extended = message.is_extended_frame or identifier > 0x7FF
                yield identifier | extended << 31

    def _clocks(self, mapping: BusMapping) -> Mapping[str, tuple[float, int]]:
        """Return nanoseconds of a tick and bits of each device's clock, by its name."""
        clocks: dict[str, tuple[float, int]] = {}
        frames = [frame for group in self.groups.values() for frame in group.frames]
        for frame in frames if self._sync is None else [self._sync, *frames]:
            if frame.time is None:
                continue
            form = frame.ns_per_tick, frame.time.length
            if clocks.setdefault(frame.clock, form) != form:
                raise InputError(
                    f'mapping {mapping.path}: message {frame.message.name!r} shows clock '
                    f'{frame.clock!r} in another resolution or size than the frames before it; '
                    "give it a name of its own with 'clock'"
                )
        return clocks

    @cached_property
    def routes(self) -> Mapping[int, Sequence[Frame]]:
        """Frames of each identifier (bit 31 set if extended)."""
        routes: dict[int, list[Frame]] = {}
        frames = [frame for group in self.groups.values() for frame in group.frames]
        for frame in frames if self._sync is None else [*frames, self._sync]:
            # A servo's standard identifier may come in an extended frame.
            for key in {frame.key, frame.key | 1 << 31} if self.polled else {frame.key}:
                routes.setdefault(key, []).append(frame)
        return routes

    def encode_sync(self, counter: int, device_us: int) -> list[can.Message]:
        """Return the frame on which all drives take their sample; [] if the bus has none."""
        if self._sync is None:
            return []
        payload = self._sync_layout.encode(self._sync.head_values(counter, device_us))
        return [_message(self._sync, payload)]

    @cached_property
    def _sync_layout(self) -> SignalLayout:
        assert self._sync is not None
        head = self._sync.head
        factors = [1 / float(signal.scale) for signal in head]
        return SignalLayout([(signal, 0) for signal in head], self._sync.size, factors)

    def encode(
        self, name: str, counter: int, device_us: int, *quantities: ArrayLike
    ) -> list[can.Message]:
        """Return the frames of one sample of a group, of its first quantities, each [D].

        Electrical values beyond the range of their signals are clipped and flagged under- or
        overrange; NaN becomes 0 and is flagged as an error of the device. ValueError for a group
        that the bus lacks, and for too few or too many quantities.
        """
        group = self._group(name)
        if not len(REQUIRED[name]) <= len(quantities) <= len(group.quantities):
            raise ValueError(f'{name} has {", ".join(group.quantities)}, not {len(quantities)}')
        values = np.zeros((len(group.quantities), len(self.drives)))
        for row, given in zip(values, quantities, strict=False):
            row[:] = given
        values = values[:, group.columns]
        least, greatest = group.limits
        if name == 'electrical' and not ((values >= least) & (values <= greatest)).all():
            values[2] = _flag(values[:2], least[:2], greatest[:2], values[2])
        payloads = group.encode(counter, device_us, values)
        return [_message(frame, data) for frame, data in zip(group.frames, payloads, strict=True)]

    def quantise(self, name: str, *quantities: ArrayLike) -> list[Floats]:
        """Return the first quantities of a group, each [..., D], as they are received.

        NaN for drives that are not mapped.
        """
        group = self._group(name)
        *rows, drives = np.shape(quantities[0])
        values = np.zeros((*rows, len(group.quantities), drives))
        for row, given in enumerate(quantities):
            values[..., row, :] = given
        result = np.full(values.shape, np.nan)
        result[..., group.columns] = group.quantise(values[..., group.columns])
        return [result[..., row, :] for row in range(len(quantities))]

    def _group(self, name: str) -> FrameGroup:
        if name not in self.groups:
            raise ValueError(f'the bus carries no {name} frames, only {", ".join(self.groups)}')
        return self.groups[name]


def load_database(path: Path) -> Database:
    """Read a DBC (or another format of cantools); InputError if it does not parse."""
    try:
        database = cantools.database.load_file(path, cache_dir=None)
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f'cannot read DBC {path}: {error}') from error
    except (cantools.database.Error, ValueError, KeyError, IndexError) as error:
        reason = ' '.join(str(error).split())[:300]
        raise InputError(f'{path} does not parse as a DBC: {reason}') from error
    if not isinstance(database, Database) or not database.messages:
        raise InputError(f'{path} holds no CAN messages')
    return database


def _message(frame: Frame, payload: bytes) -> can.Message:
    return can.Message(
        arbitration_id=frame.identifier,
        is_extended_id=frame.is_extended,
        is_fd=frame.message.is_fd,
        bitrate_switch=frame.message.is_fd,
        data=payload,
        check=False,
    )


def _flag(values: Floats, least: Floats, greatest: Floats, status: Floats) -> Floats:
    flags = status.astype(np.uint8)
    flags[np.isnan(values).any(axis=0)] |= DEVICE_ERROR
    flags[(values < least).any(axis=0)] |= UNDERRANGE
    flags[(values > greatest).any(axis=0)] |= OVERRANGE
    return flags.astype(float)
