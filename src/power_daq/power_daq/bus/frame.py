"""Frames of a bus, bound to the messages and signals of their DBC."""

from collections.abc import Sequence
from functools import cached_property
from itertools import accumulate
from typing import Final

import numpy as np
from cantools.database.can.database import Database
from cantools.database.can.message import Message
from cantools.database.can.signal import Signal
from numpy.typing import ArrayLike
from power_recordings.importing.units import SI, conversion
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError

from power_daq.bus.mapping import (
    OPTIONAL,
    REQUIRED,
    BusSignal,
    FrameMapping,
    GroupMapping,
    NodeNumbers,
)
from power_daq.bus.signal_layout import Field, LayoutError, SignalLayout, frame_length

_SHARED = ('voltage', 'status')
_TIME_UNITS = {'s': 1e9, 'ms': 1e6, 'us': 1e3, 'µs': 1e3, 'ns': 1.0, '': 1e3}
_CURRENTS: Final = ('A', 'mA')
_LARGEST_STANDARD = 0x7FF


class Frame:
    """A message of the DBC that carries samples: identifier, payload length, clock and counter.

    name: the message's, with the drive of its node. group and slot: of the sample that it is part
    of. time and counter are None where the device sends none. selector: multiplexer signal and its
    value for this frame. head: all these signals, as far as it has them. The same as fields, for
    the receiver: time_and_counter, selected.
    Raises InputError for a clock, counter or multiplexing that cannot be read.
    """

    def __init__(
        self,
        database: Database,
        entry: FrameMapping,
        nodes: NodeNumbers | None,
        group: str,
        slot: int,
    ) -> None:
        self.group, self.slot = group, slot
        message = find_message(database, entry)
        self.message = message
        self.name = message.name
        self.identifier = message.frame_id
        if entry.node is not None and nodes is not None:
            number, drive = entry.node
            self.identifier |= number << nodes.shift
            self.name = f'{drive} {message.name}'
        self.is_extended = message.is_extended_frame or self.identifier > _LARGEST_STANDARD
        self.size = frame_length(message.length)
        self.clock = entry.clock
        self.time: Signal | None = None
        self.counter: Signal | None = None
        self.head: list[Signal] = []
        self.ns_per_tick = 1.0
        self.time_and_counter: tuple[Field, Field] | None = None
        self.selected: tuple[Field, int] | None = None
        names = [given.source for _, _, given in entry.quantities()]
        if entry.time is not None and entry.counter is not None:
            self.time = find_signal(message, entry.time, entry)
            self.counter = find_signal(message, entry.counter, entry)
            _check_head(self.time, self.counter, entry)
            self.ns_per_tick = _TIME_UNITS[self.time.unit or ''] * float(self.time.scale)
            self.head = [self.time, self.counter]
            self.time_and_counter = Field.of(self.time), Field.of(self.counter)
            names += [entry.time, entry.counter]
        self.selector = _selector(message, names, entry)
        if self.selector is not None:
            self.head.append(self.selector[0])
            self.selected = Field.of(self.selector[0]), self.selector[1]

    @property
    def key(self) -> int:
        """Identifier as SocketCAN writes it: bit 31 marks an extended one."""
        return self.identifier | self.is_extended << 31

    def head_values(self, counter: int, device_us: int) -> list[int]:
        """Return raw values of `head`; counter and clock wrap."""
        values = []
        if self.time is not None and self.counter is not None:
            ticks = round(device_us * 1000 / self.ns_per_tick) % (1 << self.time.length)
            values = [ticks, counter % (1 << self.counter.length)]
        return values if self.selector is None else [*values, self.selector[1]]


def find_message(database: Database, entry: FrameMapping) -> Message:
    """Return the message of an entry; InputError lists the messages of the DBC."""
    for message in database.messages:
        if message.name == entry.message:
            return message
    names = ', '.join(message.name for message in database.messages)
    raise InputError(
        f'mapping {entry.where}: message {entry.message!r} is not in the DBC; there are {names}'
    )


def find_signal(message: Message, name: str, entry: FrameMapping) -> Signal:
    """Return the signal of a message; InputError lists its signals."""
    for signal in message.signals:
        if signal.name == name:
            return signal
    names = ', '.join(signal.name for signal in message.signals)
    raise InputError(
        f'mapping {entry.where}: signal {name!r} is not in message {message.name!r}; '
        f'there are {names}'
    )


def _check_head(time: Signal, counter: Signal, entry: FrameMapping) -> None:
    if (time.unit or '') not in _TIME_UNITS:
        units = ', '.join(unit for unit in _TIME_UNITS if unit)
        raise InputError(
            f'mapping {entry.where}: time signal {time.name!r} has unit {time.unit!r}, not {units}'
        )
    for signal in (time, counter):
        if signal.is_float or signal.is_signed or signal.offset:
            raise InputError(
                f'mapping {entry.where}: signal {signal.name!r} is not an unsigned integer '
                'without offset, as clocks and counters have to be'
            )


def _selector(
    message: Message, names: Sequence[str], entry: FrameMapping
) -> tuple[Signal, int] | None:
    chosen = [s for s in message.signals if s.name in names and s.multiplexer_ids]
    if not chosen:
        return None
    selectors = {signal.multiplexer_signal for signal in chosen}
    common = set.intersection(*(set(signal.multiplexer_ids or ()) for signal in chosen))
    if len(selectors) > 1 or not common:
        raise InputError(
            f'mapping {entry.where}: the signals of message {message.name!r} never come in one '
            'frame (multiplexed); give each value of the multiplexer a frame of its own'
        )
    selector = find_signal(message, selectors.pop() or '', entry)
    if selector.multiplexer_ids:
        raise InputError(
            f'mapping {entry.where}: message {message.name!r} has nested multiplexers, '
            'which cannot be read'
        )
    return selector, min(common)


def factor_of(signal: Signal, given: BusSignal, quantity: str, entry: FrameMapping) -> float:
    """Return the factor from a signal to SI; InputError for a unit of another quantity."""
    sign = -1.0 if given.positive == 'fed' else 1.0
    if given.scale is not None:
        return sign * given.scale
    unit = given.unit or signal.unit or ''
    if not unit or quantity not in SI:
        return sign
    try:
        found = conversion(unit, 'current' if is_current(quantity, unit) else quantity)
    except InputError as error:
        raise InputError(f'mapping {entry.where}: signal {signal.name!r}: {error}') from None
    if found.offset:
        raise InputError(f'mapping {entry.where}: signal {signal.name!r} is in {unit}, not degC')
    return sign * found.factor


def is_current(quantity: str, unit: str) -> bool:
    """Return whether a torque is reported as the current that makes it."""
    return quantity == 'torque' and unit in _CURRENTS


def check_shared(entry: FrameMapping) -> None:
    """Raise InputError for a signal mapped twice; drives may share a voltage or status."""
    used: dict[str, tuple[str, str]] = {}
    for drive, quantity, given in entry.quantities():
        first = used.setdefault(given.source, (drive, quantity))
        if first != (drive, quantity) and not (first[1] == quantity and quantity in _SHARED):
            raise InputError(
                f'mapping {entry.where}: signal {given.source!r} is both {first[1]} of '
                f'{first[0]!r} and {quantity} of {drive!r}'
            )


class FrameGroup:
    """The frames of one sample of Q quantities of D drives.

    Values are [Q, D] in SI units, in the order of `quantities` and `drives`; columns are the
    drives' indices among all drives of the bus; slots [Q, D] are the indices of the frames that
    carry the values, -1 for none. torque_at and torque_unit are by drive, as in a card.
    """

    def __init__(
        self,
        mapping: GroupMapping,
        database: Database,
        drives: Sequence[str],
        nodes: NodeNumbers | None = None,
    ) -> None:
        self.name, self.rate, self.drives = mapping.name, mapping.rate, mapping.drives
        self.columns = np.array([drives.index(drive) for drive in self.drives], np.intp)
        mapped = {q for entry in mapping.frames for _, q, _ in entry.quantities()}
        optional = [q for q in OPTIONAL.get(self.name, ()) if q in mapped or q != 'power']
        self.quantities = (*REQUIRED[self.name], *optional)
        self.torque_at: dict[str, str] = {}
        self.torque_unit: dict[str, str] = {}
        self.frames = tuple(
            Frame(database, entry, nodes, mapping.name, slot)
            for slot, entry in enumerate(mapping.frames)
        )
        *bases, size = accumulate((frame.size for frame in self.frames), initial=0)
        data: list[tuple[Signal, int]] = []
        factors, places, slots = [], [], []
        for entry, frame in zip(mapping.frames, self.frames, strict=True):
            for drive, quantity, given in entry.quantities():
                signal = find_signal(frame.message, given.source, entry)
                row = self.quantities.index(quantity)
                places.append(row * len(self.drives) + self.drives.index(drive))
                data.append((signal, bases[frame.slot]))
                factors.append(factor_of(signal, given, quantity, entry))
                slots.append(frame.slot)
                is_scaled = given.scale is not None
                if not is_scaled and is_current(quantity, given.unit or signal.unit or ''):
                    self.torque_unit[drive] = 'A'
                    self.torque_at[drive] = 'motor'
                elif given.at:
                    self.torque_at[drive] = given.at
            check_shared(entry)
        counter = self.frames[0].counter
        self.counter_bits = None if counter is None else counter.length
        self._check_frames(mapping)
        self._places = np.array(places, np.intp)
        self.slots = np.full(self.shape, -1)
        self.slots.reshape(-1)[self._places] = slots
        self._powered = None
        if 'power' in mapped:
            self._powered = np.flatnonzero(self.slots[3] >= 0)
            self.slots[1, self._powered] = self.slots[3, self._powered]
        heads = [(s, base) for f, base in zip(self.frames, bases, strict=True) for s in f.head]
        head_factors = [1 / float(signal.scale) for signal, _ in heads]
        try:
            self._layout = SignalLayout(data, size, factors)
            self._encoder = SignalLayout(data + heads, size, factors + head_factors)
        except LayoutError as error:
            raise InputError(f'mapping {mapping.frames[0].where}: {error}') from error

    def _check_frames(self, mapping: GroupMapping) -> None:
        for index, (frame, entry) in enumerate(zip(self.frames, mapping.frames, strict=True)):
            if frame.counter is not None and frame.counter.length != self.counter_bits:
                raise InputError(
                    f'mapping {entry.where}: counter {entry.counter!r} has {frame.counter.length} '
                    f'bits, those before it have {self.counter_bits}; frames of one sample '
                    'need counters of one size'
                )
            for earlier in self.frames[:index]:
                selectors = earlier.selector, frame.selector
                apart = None not in selectors and selectors[0] != selectors[1]
                if earlier.key == frame.key and not apart:
                    raise InputError(
                        f'mapping {entry.where}: message {entry.message!r} is there twice'
                    )

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of quantities and drives, (Q, D)."""
        return len(self.quantities), len(self.drives)

    def decode(self, payloads: Sequence[bytes]) -> Floats:
        """Return the values [Q, D] of all frames' payloads; unmapped quantities are 0.

        The current of a drive whose power is mapped is power over voltage.
        """
        values = np.zeros(self.shape)
        values.reshape(-1)[self._places] = self._layout.decode(b''.join(payloads))
        if self._powered is not None:
            with np.errstate(divide='ignore', invalid='ignore'):
                values[1, self._powered] = values[3, self._powered] / values[0, self._powered]
        return values

    def quantise(self, values: ArrayLike) -> Floats:
        """Return values [..., Q, D] as they are after encoding and decoding."""
        flat = self._flat(values)
        result = np.zeros_like(flat)
        result[..., self._places] = self._layout.quantise(flat[..., self._places])
        return result.reshape(np.shape(values))

    @cached_property
    def limits(self) -> tuple[Floats, Floats]:
        """Least and greatest value [Q, D] of the signals; infinite where not mapped."""
        least, greatest = np.full(self.shape, -np.inf), np.full(self.shape, np.inf)
        least.reshape(-1)[self._places], greatest.reshape(-1)[self._places] = self._layout.limits
        return least, greatest

    def encode(self, counter: int, device_us: int, values: ArrayLike) -> list[bytes]:
        """Return a payload per frame for values [Q, D]; counter and clock wrap."""
        head = [n for frame in self.frames for n in frame.head_values(counter, device_us)]
        flat = self._flat(values)[self._places]
        payload = self._encoder.encode(np.concatenate([flat, head]))
        payloads = []
        for frame in self.frames:
            payloads.append(payload[: frame.size])
            payload = payload[frame.size :]
        return payloads

    def _flat(self, values: ArrayLike) -> Floats:
        array = np.asarray(values, float)
        if array.shape[-2:] != self.shape:
            raise ValueError(
                f'{self.name} values have shape {array.shape}, not [..., {self.shape}]'
            )
        return array.reshape(*array.shape[:-2], -1)
