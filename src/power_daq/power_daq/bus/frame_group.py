"""Frames that make up one sample of the drives, and their values."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from cantools.database.can.database import Database
from cantools.database.can.signal import Signal
from numpy.typing import ArrayLike
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError

from power_daq.bus.frame import (
    bind_frame,
    check_shared,
    factor_of,
    find_message,
    find_signal,
    head_values,
    heads,
    is_current,
)
from power_daq.bus.mapping import OPTIONAL, REQUIRED, BusSignal, GroupMapping, NodeNumbers
from power_daq.bus.signal_layout import LayoutError, SignalLayout


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
        self.name = mapping.name
        self.rate = mapping.rate
        self.drives = mapping.drives
        self.columns = np.array([drives.index(drive) for drive in self.drives], np.intp)
        mapped = {q for entry in mapping.frames for _, q, _ in entry.quantities()}
        optional = [q for q in OPTIONAL.get(self.name, ()) if q in mapped or q != 'power']
        self.quantities = (*REQUIRED[self.name], *optional)
        self.torque_at: dict[str, str] = {}
        self.torque_unit: dict[str, str] = {}
        frames, signals, factors, places, bases, slots = [], [], [], [], [], []
        base = 0
        for slot, entry in enumerate(mapping.frames):
            message = find_message(database, entry)
            for drive, quantity, given in entry.quantities():
                signal = find_signal(message, given.source, entry)
                row = self.quantities.index(quantity)
                places.append(row * len(self.drives) + self.drives.index(drive))
                signals.append(signal)
                factors.append(factor_of(signal, given, quantity, entry))
                bases.append(base)
                slots.append(slot)
                if quantity == 'torque':
                    self._note_torque(drive, given, signal)
            names = [given.source for _, _, given in entry.quantities()]
            frames.append(bind_frame(message, entry, names, nodes))
            check_shared(entry)
            base += frames[-1].size
        self.frames = tuple(frames)
        self.counter_bits = frames[0].counter.length if frames[0].counter is not None else None
        self._check_frames(mapping)
        self._places = np.array(places, np.intp)
        self.slots = np.full(self.shape, -1)
        self.slots.reshape(-1)[self._places] = slots
        self._powered = None
        if 'power' in mapped:
            self._powered = np.flatnonzero(self.slots[3] >= 0)
            self.slots[1, self._powered] = self.slots[3, self._powered]
        data = list(zip(signals, bases, strict=True))
        head_signals, head_factors = heads(frames)
        try:
            self._layout = SignalLayout(data, base, factors)
            self._encoder = SignalLayout(data + head_signals, base, factors + head_factors)
        except LayoutError as error:
            raise InputError(f'mapping {mapping.frames[0].where}: {error}') from error

    def _note_torque(self, drive: str, given: BusSignal, signal: Signal) -> None:
        if given.scale is None and is_current('torque', given.unit or signal.unit or ''):
            self.torque_unit[drive] = 'A'
            self.torque_at[drive] = 'motor'
        elif given.at:
            self.torque_at[drive] = given.at

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
        """(Q, D)."""
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
        head: list[int] = []
        for frame in self.frames:
            head += head_values(frame, counter, device_us)
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
