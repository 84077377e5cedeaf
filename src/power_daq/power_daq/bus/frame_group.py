"""Frames that make up one sample of the drives, bound to their DBC."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import pi

import numpy as np
from cantools.database.can.database import Database
from cantools.database.can.message import Message
from cantools.database.can.signal import Signal
from numpy.typing import ArrayLike
from wattwalk_core.errors import InputError

from power_daq.bus.mapping import OPTIONAL, REQUIRED, FrameMapping, GroupMapping
from power_daq.bus.signal_layout import Field, Floats, LayoutError, SignalLayout

_SHARED = ('voltage', 'status')
_TIME_UNITS = {'s': 1e9, 'ms': 1e6, 'us': 1e3, 'µs': 1e3, 'ns': 1.0, '': 1e3}
_UNITS: Mapping[str, Mapping[str, float]] = {
    'voltage': {'V': 1.0, 'mV': 1e-3, '': 1.0},
    'current': {'A': 1.0, 'mA': 1e-3, '': 1.0},
    'position': {'rad': 1.0, 'mrad': 1e-3, 'deg': pi / 180, '°': pi / 180, '': 1.0},
    'velocity': {
        'rad/s': 1.0,
        'mrad/s': 1e-3,
        '': 1.0,
        'deg/s': pi / 180,
        '°/s': pi / 180,
        'rpm': pi / 30,
        '1/min': pi / 30,
    },
    'torque': {'Nm': 1.0, 'N.m': 1.0, 'N·m': 1.0, 'mNm': 1e-3, '': 1.0},
    'temperature': {'degC': 1.0, '°C': 1.0, 'C': 1.0, '': 1.0},
}
_FD_LENGTHS = (*range(9), 12, 16, 20, 24, 32, 48, 64)


@dataclass(frozen=True)
class Frame:
    """
    A message of the DBC that carries samples: its payload length, clock and counter.

    selector: multiplexer signal and its value for this frame.
    """

    message: Message
    clock: str
    time: Signal
    counter: Signal
    ns_per_tick: float
    size: int
    selector: tuple[Signal, int] | None = None

    @property
    def key(self) -> int:
        """Identifier as SocketCAN writes it: bit 31 marks an extended one."""
        return self.message.frame_id | self.message.is_extended_frame << 31


@dataclass(frozen=True)
class Route:
    """The fields of a frame that the receiver reads before its sample is complete."""

    message: str
    group: str
    slot: int
    size: int
    time: Field
    counter: Field
    clock: str
    selector: tuple[Field, int] | None


class FrameGroup:
    """
    The frames of one sample of Q quantities of D drives.

    Values are [Q, D] in SI units, in the order of `quantities` and `drives`; columns are the
    drives' indices among all drives of the bus.
    """

    def __init__(self, mapping: GroupMapping, database: Database, drives: Sequence[str]) -> None:
        self.name = mapping.name
        self.rate = mapping.rate
        self.drives = mapping.drives
        self.columns = np.array([drives.index(drive) for drive in self.drives], np.intp)
        self.quantities = REQUIRED[self.name] + OPTIONAL.get(self.name, ())
        frames, signals, factors, places, bases = [], [], [], [], []
        base = 0
        for entry in mapping.frames:
            message = find_message(database, entry)
            for drive, quantity, name in entry.quantities():
                signal = find_signal(message, name, entry)
                row = self.quantities.index(quantity)
                places.append(row * len(self.drives) + self.drives.index(drive))
                signals.append(signal)
                factors.append(_factor(signal, quantity, entry))
                bases.append(base)
            frames.append(bind_frame(message, entry, [name for _, _, name in entry.quantities()]))
            _check_shared(entry)
            base += frames[-1].size
        self.frames = tuple(frames)
        self.counter_bits = frames[0].counter.length
        self._check_frames(mapping)
        self._places = np.array(places, np.intp)
        data = list(zip(signals, bases, strict=True))
        heads, head_factors = _heads(frames)
        try:
            self._layout = SignalLayout(data, base, factors)
            self._encoder = SignalLayout(data + heads, base, factors + head_factors)
        except LayoutError as error:
            raise InputError(f'mapping {mapping.frames[0].where}: {error}') from error

    def _check_frames(self, mapping: GroupMapping) -> None:
        for index, (frame, entry) in enumerate(zip(self.frames, mapping.frames, strict=True)):
            if frame.counter.length != self.counter_bits:
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
        """(Q, D)."""
        return len(self.quantities), len(self.drives)

    def decode(self, payloads: Sequence[bytes]) -> Floats:
        """Return the values [Q, D] of all frames' payloads; unmapped quantities are 0."""
        values = np.zeros(self.shape)
        values.reshape(-1)[self._places] = self._layout.decode(b''.join(payloads))
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
        heads: list[int] = []
        for frame in self.frames:
            heads += head_values(frame, counter, device_us)
        flat = self._flat(values)[self._places]
        payload = self._encoder.encode(np.concatenate([flat, heads]))
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


def head_values(frame: Frame, counter: int, device_us: int) -> list[int]:
    """Return raw clock, counter and, where there is one, multiplexer of a frame."""
    ticks = round(device_us * 1000 / frame.ns_per_tick) % (1 << frame.time.length)
    head = [ticks, counter % (1 << frame.counter.length)]
    return head if frame.selector is None else [*head, frame.selector[1]]


def head_layout(frame: Frame) -> SignalLayout:
    """Return the layout of head_values alone, for a frame without drives."""
    placed, factors = _heads([frame])
    return SignalLayout(placed, frame.size, factors)


def _heads(frames: Sequence[Frame]) -> tuple[list[tuple[Signal, int]], list[float]]:
    placed: list[tuple[Signal, int]] = []
    base = 0
    for frame in frames:
        placed += [(frame.time, base), (frame.counter, base)]
        if frame.selector is not None:
            placed.append((frame.selector[0], base))
        base += frame.size
    return placed, [1 / float(signal.scale) for signal, _ in placed]


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


def bind_frame(message: Message, entry: FrameMapping, names: Sequence[str]) -> Frame:
    """Return a message as a frame; InputError for its clock, counter or multiplexing."""
    time = find_signal(message, entry.time, entry)
    counter = find_signal(message, entry.counter, entry)
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
    return Frame(
        message=message,
        clock=entry.clock,
        time=time,
        counter=counter,
        ns_per_tick=_TIME_UNITS[time.unit or ''] * float(time.scale),
        size=next(length for length in _FD_LENGTHS if length >= message.length),
        selector=_selector(message, [entry.time, entry.counter, *names], entry),
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


def _factor(signal: Signal, quantity: str, entry: FrameMapping) -> float:
    units = _UNITS.get(quantity)
    if units is None:
        return 1.0
    if (signal.unit or '') not in units:
        known = ', '.join(unit for unit in units if unit)
        raise InputError(
            f'mapping {entry.where}: {quantity} signal {signal.name!r} has unit '
            f'{signal.unit!r}; understood are {known}'
        )
    return units[signal.unit or '']


def _check_shared(entry: FrameMapping) -> None:
    used: dict[str, tuple[str, str]] = {}
    for drive, quantity, signal in entry.quantities():
        first = used.setdefault(signal, (drive, quantity))
        if first != (drive, quantity) and not (first[1] == quantity and quantity in _SHARED):
            raise InputError(
                f'mapping {entry.where}: signal {signal!r} is both {first[1]} of {first[0]!r} '
                f'and {quantity} of {drive!r}'
            )
