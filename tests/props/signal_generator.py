"""A generator of the frames of moving drives, to try a DAQ without a robot."""

import threading
import time
from collections.abc import Callable, Sequence

import can
import numpy as np
from power_daq.bus.description import BusDescription
from power_daq.bus.unix_socket import UnixSocketBus

_MS = 1_000_000


class SignalGenerator:
    """
    Sends what drives would send, in real time: sine waves, each drive with a phase of its own.

    Electrical frames come each millisecond, joint frames each 2.5 ms, temperatures each 100 ms.
    A sample that is sent late keeps the device time at which it was due. The device clock shows
    start_us when the generator begins and gains `drift` (1) on the steady clock. Frames whose
    identifier is in `silenced` are not sent.
    """

    def __init__(
        self,
        description: BusDescription,
        bus: can.BusABC,
        drift: float = 0.0,
        start_us: int = 0,
        steady: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._description = description
        self._bus = bus
        self._steady = steady
        self.drift = drift
        self.start_us = start_us
        self.counter_offset = 0
        self.begin = steady()
        self.silenced: set[int] = set()
        self._sent = 0
        self._phase = np.arange(len(description.drives))
        self._next = self._millisecond(0)

    def true_time(self, device_us: int) -> int:
        """Steady time in ns at which the device clock showed this (unwrapped) time."""
        return self.begin + round((device_us - self.start_us) * 1000 / (1 + self.drift))

    def send_due(self) -> None:
        """Send all samples that are due by now."""
        now = self._steady()  # read once: a machine under load never catches up
        while self.begin + self._sent * _MS <= now:
            self._send([m for m in self._next if m.arbitration_id not in self.silenced])
            self._sent += 1
            self._next = self._millisecond(self._sent)

    def run(self, stop: threading.Event) -> None:
        """Send until told to stop."""
        while not stop.is_set():
            self.send_due()
            pause = self.begin + self._sent * _MS - self._steady()
            time.sleep(max(0, pause) * 1e-9)

    def _send(self, messages: Sequence[can.Message]) -> None:
        if isinstance(self._bus, UnixSocketBus):
            self._bus.send_all(messages)
            return
        for message in messages:
            self._bus.send(message)

    def _device_us(self, microseconds: float) -> int:
        return self.start_us + int(microseconds * (1 + self.drift))

    def _millisecond(self, number: int) -> list[can.Message]:
        bus, groups = self._description, self._description.groups
        counter, device_us = number + self.counter_offset, self._device_us(1000 * number)
        wave = np.sin(2 * np.pi * 1e-3 * number + self._phase)
        messages = bus.encode_sync(counter, device_us)
        if 'electrical' in groups:
            messages += bus.encode('electrical', counter, device_us, 48.0 - 0.1 * wave, 4.0 * wave)
        if 'temperature' in groups and number % 100 == 0:
            counter = number // 100 + self.counter_offset
            messages += bus.encode('temperature', counter, device_us, 40.0 + self._phase)
        if 'joints' in groups and number % 5 in (0, 3):
            index = 2 * number // 5
            counter, device_us = index + self.counter_offset, self._device_us(2500 * index)
            messages += bus.encode(
                'joints', counter, device_us, 0.5 * wave, 3.0 * wave, 20.0 * wave
            )
        return messages
