"""Assembly of samples from frames by their counters, and the count of lost samples."""

from typing import NamedTuple

from wattwalk_core.arrays import Bools, Floats

from power_daq.bus.frame import FrameGroup
from power_daq.clock.mapping import WrappingCounter

_OPEN_SAMPLES = 8
_SLACK = 1.5


class Assembled(NamedTuple):
    """Complete sample: its index, the device time in ns of its first frame, values [Q, D].

    stale [Q, D]: True where no frame came near the sample's time; None where all frames came.
    """

    number: int
    device_time: int
    values: Floats
    stale: Bools | None = None


class _Open:
    """An incomplete sample."""

    __slots__ = ('device_time', 'missing', 'payloads')

    def __init__(self, slots: int) -> None:
        self.payloads: list[bytes] = [b''] * slots
        self.missing = slots
        self.device_time = 0


class _Seen(NamedTuple):
    """The newest frame of a slot."""

    raw: int
    number: int
    device_time: int


class Assembler:
    """Combines the frames of one group to samples by their counter.

    A sample needs all of its frames; one with a missing frame is lost and never filled up with
    older values. Indices count samples and do not wrap: a step of more than one is a loss.
    Devices send in order, so a complete sample closes all before it.
    """

    def __init__(self, group: FrameGroup) -> None:
        self._group = group
        assert group.counter_bits is not None, 'frames without counter are interleaved'
        self._counter = WrappingCounter(group.counter_bits)
        self._slots = len(group.frames)
        self._seen: list[_Seen | None] = [None] * self._slots
        self._open: dict[int, _Open] = {}
        self._newest: _Seen | None = None
        self._newest_arrival = 0
        self._resync = False
        self._first: int | None = None
        self._closed = -1
        self.received = 0
        self.duplicates = 0
        self.counter_jumps = 0
        self.missing = [0] * self._slots

    @property
    def lost(self) -> int:
        """Number of samples that remained incomplete or never came, by the counters."""
        return 0 if self._first is None else self._closed - self._first + 1 - self.received

    def restart(self) -> None:
        """Accept any next counter, after a restart of the device."""
        self._resync = self._newest is not None
        self._seen = [None] * self._slots
        if self._open:
            self._close(max(self._open))

    def add(
        self, slot: int, raw: int, device_time: int, arrival: int, payload: bytes
    ) -> Assembled | None:
        """Take the frame of a slot with its raw counter; return the sample if it is complete.

        device_time: of the sample, in ns. arrival: of the frame on the steady clock, in ns.
        """
        index = self._index(slot, raw, device_time, arrival)
        if self._first is not None and index <= self._closed:
            self.duplicates += 1
            return None
        if self._slots == 1:
            return self._complete(index, device_time, [payload])
        part = self._open.get(index)
        if part is None:
            part = self._open[index] = _Open(self._slots)
        if part.payloads[slot]:
            self.duplicates += 1
            return None
        part.payloads[slot] = payload
        part.missing -= 1
        if slot == 0:
            part.device_time = device_time
        if not part.missing:
            return self._complete(index, part.device_time, part.payloads)
        if len(self._open) > _OPEN_SAMPLES:
            self._close(min(self._open))
        return None

    def _complete(self, index: int, device_time: int, payloads: list[bytes]) -> Assembled:
        self._open.pop(index, None)
        self._close(index)
        self.received += 1
        return Assembled(index, device_time, self._group.decode(payloads))

    def _close(self, index: int) -> None:
        """Close all samples up to index; incomplete ones are lost."""
        if self._first is None:
            self._first = index
        for late in [i for i in self._open if i <= index] if self._open else ():
            part = self._open.pop(late)
            if late >= self._first:
                for slot, payload in enumerate(part.payloads):
                    self.missing[slot] += not payload
        self._closed = index

    def _index(self, slot: int, raw: int, device_time: int, arrival: int) -> int:
        last = self._seen[slot]
        index = None if last is None else self._follow(last, raw, device_time)
        if index is None:
            index = self._align(raw, arrival)
        seen = _Seen(raw, index, device_time)
        if last is None or index > last.number:
            self._seen[slot] = seen
        if self._newest is None or index > self._newest.number:
            self._newest, self._newest_arrival = seen, arrival
        return index

    def _follow(self, last: _Seen, raw: int, device_time: int) -> int | None:
        """Return a frame's index by the last one of its slot; None if the counter went back."""
        expected = (device_time - last.device_time) * self._group.rate * 1e-9
        step = self._counter.advance(last.raw, raw, round(expected))
        if step <= 0 and expected > 0.5:
            self.counter_jumps += 1
            self.restart()
            return None
        if step - expected > _SLACK + 0.05 * expected:
            self.counter_jumps += 1
        return last.number + step

    def _align(self, raw: int, arrival: int) -> int:
        """Return the index of a slot's first frame by other slots or the time since the last."""
        newest = self._newest
        if newest is None:
            return 0
        if self._resync:
            self._resync = False
            elapsed = (arrival - self._newest_arrival) * self._group.rate * 1e-9
            return max(newest.number, self._closed) + max(2, round(elapsed))
        return newest.number + self._counter.advance(newest.raw, raw, 0)
