"""Readings as CAN FD frames, and the bus that carries them."""

from collections.abc import Sequence
from itertools import count
from typing import Any, Final

import can
import numpy as np
from numpy.typing import NDArray
from power_daq.bus.description import BusDescription
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError

from sim_bridge.sensors.blocks import BusColumns, InstrumentReadings
from sim_bridge.sensors.meter import DeviceClock

INTERFACES: Final = ('unixsocket', 'virtual', 'socketcan')
_SEND_TIMEOUT: Final = 0.2  # s


class FrameEncoder:
    """Encoder of readings as frames in the order of time, with rolling counters."""

    def __init__(self, bus: BusDescription, joints: Sequence[str], clock: DeviceClock) -> None:
        """InputError for a joint that the bus lacks."""
        self._bus = bus
        self._clock = clock
        self._columns = BusColumns(bus, joints)
        self._counts = {name: count() for name in ('electrical', 'joints', 'temperature')}

    def encode(self, samples: InstrumentReadings) -> list[can.Message]:
        """Return SYNC and electrical frames at 1 kHz, joints at 400 Hz, temperatures at 10 Hz."""
        bus, timed = self._bus, []
        meter, joints, warmth = samples.electrical, samples.joints, samples.temperature
        wide = self._spread(meter.voltage, meter.current, meter.status)
        for step, time, row in zip(meter.step, self._us(meter.step), wide, strict=True):
            number = next(self._counts['electrical'])
            timed.append((step, 0, bus.encode_sync(number, time)))
            timed.append((step, 1, bus.encode('electrical', number, time, *row)))
        wide = self._spread(joints.position, joints.velocity, joints.torque)
        for step, time, row in zip(joints.step, self._us(joints.step), wide, strict=True):
            number = next(self._counts['joints'])
            timed.append((step, 2, bus.encode('joints', number, time, *row)))
        wide = self._spread(warmth.temperature)
        for step, time, row in zip(warmth.step, self._us(warmth.step), wide, strict=True):
            number = next(self._counts['temperature'])
            timed.append((step, 3, bus.encode('temperature', number, time, *row)))
        timed.sort(key=lambda entry: entry[:2])
        return [message for _, _, messages in timed for message in messages]

    def _us(self, step: NDArray[np.int64]) -> list[int]:
        shown: list[int] = (self._clock.device_ns(step) // 1000).tolist()
        return shown

    def _spread(self, *quantities: NDArray[np.generic]) -> Floats:
        return np.stack([self._columns.spread(values) for values in quantities], axis=1)


class SimulatedBus:
    """The bus of the simulated devices; the host of a Unix socket."""

    def __init__(self, interface: str, channel: str) -> None:
        """InputError for an unknown interface or a channel that cannot be opened."""
        if interface not in INTERFACES:
            raise InputError(f'interface is {interface!r}; it is one of {", ".join(INTERFACES)}')
        options: dict[str, Any] = {'host': True} if interface == 'unixsocket' else {}
        try:
            self._bus = can.Bus(
                interface=interface, channel=channel, fd=True, ignore_config=True, **options
            )
        except (can.CanError, OSError, ValueError) as error:
            raise InputError(f'cannot open {interface} bus {channel!r}: {error}') from error
        self._send_all = getattr(self._bus, 'send_all', None)
        self.refused = 0

    def send(self, messages: Sequence[can.Message]) -> None:
        """Put frames on the bus; refused ones are counted in `refused`."""
        if self._send_all is not None:
            self._send_all(messages)
            return
        for message in messages:
            try:
                self._bus.send(message, timeout=_SEND_TIMEOUT)
            except can.CanError:
                self.refused += 1

    def close(self) -> None:
        """Leave the bus."""
        self._bus.shutdown()
