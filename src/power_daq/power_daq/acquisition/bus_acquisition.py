"""The thread that reads a CAN bus, reopens it after a loss, and knows its state."""

import logging
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from queue import Empty, SimpleQueue

import can
from wattwalk_core.nodes.diagnostics import LogTarget
from wattwalk_core.worker import DeviceWorker

from power_daq.acquisition.receiver import Receiver, Sample
from power_daq.bus.unix_socket import MalformedPacketError


class QueryRounds:
    """Sends the same frames each `period` s, from the thread that reads the bus.

    A round that is late is not made up for. A frame that the bus does not take is counted as
    unsent: without a device that acknowledges, the queue of the interface is full.
    """

    def __init__(self, queries: Sequence[can.Message], period: float) -> None:
        self._queries = queries
        self._period = period
        self._next = 0.0
        self.sent = self.unsent = 0

    def send_due(self, bus: can.BusABC) -> float:
        """Send a round if it is due; return the time in s until the next one."""
        now = time.monotonic()
        if now >= self._next:
            for query in self._queries:
                try:
                    bus.send(query, timeout=0)
                    self.sent += 1
                except can.CanOperationError:
                    self.unsent += 1
            self._next += self._period
            if self._next <= now:
                self._next = now + self._period
        return self._next - now


_log = logging.getLogger(__name__)
_S = 1_000_000_000
_STEP = 1_000_000  # ns that the system clock may move against the steady one between two frames


class BusState(Enum):
    """State of a bus: not open, no frames of the mapping for some time, or such frames now."""

    ABSENT = 'absent'
    SILENT = 'silent'
    ACTIVE = 'active'


@dataclass(frozen=True)
class Patience:
    """Limits in s: pauses before reopening, silence of a bus, one read, largest age of a frame."""

    first_retry: float = 0.1
    last_retry: float = 2.0
    silence: float = 0.5
    read: float = 0.1
    largest_age: float = 0.05


class SampleQueue:
    """A bounded queue between threads; when it is full, new samples are dropped and counted.

    refused and published count samples by group (electrical, joints, temperature): dropped ones,
    and published ones, which the publisher adds.
    """

    def __init__(self, size: int) -> None:
        self._queue: SimpleQueue[Sample] = SimpleQueue()
        self._size = size
        self.refused: Counter[str] = Counter()
        self.published: Counter[str] = Counter()

    @property
    def dropped(self) -> int:
        """Samples for which there was no room."""
        return self.refused.total()

    def put(self, sample: Sample) -> None:
        """Append a sample without waiting; when the queue is full, drop and count it."""
        if self._queue.qsize() >= self._size:
            self.refused[sample.group] += 1
        else:
            self._queue.put(sample)

    def get(self, timeout: float) -> Sample | None:
        """Return the oldest sample, or None if none arrives within timeout (s)."""
        try:
            return self._queue.get(timeout=timeout)
        except Empty:
            return None

    def __len__(self) -> int:
        return self._queue.qsize()


class Arrivals:
    """Arrival times of frames on the steady clock: now, less the age by the driver's stamp.

    The driver stamps in system time. If that was stepped while a frame waited, its age is unknown;
    for largest_age (s) after a step, frames therefore count as arriving when they are read.
    """

    def __init__(
        self,
        largest_age: float,
        now: Callable[[], int] | None = None,
        steady: Callable[[], int] | None = None,
    ) -> None:
        self._now, self._steady = now or time.time_ns, steady or time.monotonic_ns
        self._largest = int(largest_age * _S)
        self._offset: int | None = None
        self._known_from = 0

    def of(self, timestamp: float) -> int:
        """Return the steady time in ns at which a frame with a timestamp (s) arrived."""
        now, steady = self._now(), self._steady()
        before, self._offset = self._offset, now - steady
        if before is None or abs(self._offset - before) > _STEP:
            self._known_from = steady + self._largest
        age = now - int(timestamp * _S)
        return steady - age if steady >= self._known_from and 0 < age < self._largest else steady


class Acquisition(DeviceWorker):
    """Reads a bus in a thread of its own and hands samples to a sink.

    open_bus may raise can.CanError or OSError: the bus is absent and is tried again with growing
    pauses, as is a bus that is lost before a frame of the mapping came. Any other exception ends
    the thread and is raised by `join`. log gets a line whenever the bus appears or is lost.
    queries: frames to devices that send nothing unless they are queried.
    """

    def __init__(
        self,
        receiver: Receiver,
        open_bus: Callable[[], can.BusABC],
        sink: Callable[[Sample], None],
        log: LogTarget = _log,
        patience: Patience | None = None,
        queries: QueryRounds | None = None,
    ) -> None:
        self.receiver = receiver
        self._log = log
        self._open_bus = open_bus
        self._sink = sink
        self._patience = patience or Patience()
        self.queries = queries
        super().__init__('acquisition', self._patience.first_retry, self._patience.last_retry)
        self._bus: can.BusABC | None = None
        self.absence = 'not opened yet'
        self.opened = 0

    @property
    def state(self) -> BusState:
        """State of the bus now."""
        if self._bus is None:
            return BusState.ABSENT
        age = time.monotonic_ns() - self.receiver.last_mapped
        return BusState.ACTIVE if age < self._patience.silence * _S else BusState.SILENT

    @property
    def _given(self) -> int:
        return self.receiver.counts.mapped

    def _serve_once(self) -> None:
        try:
            bus = self._open_bus()
        except (can.CanError, OSError) as error:
            if str(error) != self.absence:
                self._log.warning(f'bus absent, will try again: {error}')
            self.absence = str(error)
            return
        self._bus = bus
        self.opened += 1
        self._log.info(f'reading {bus.channel_info}')
        try:
            self._read(bus)
        except (can.CanError, OSError) as error:
            self.absence = str(error)
            self._log.warning(f'bus lost: {error}')
        finally:
            self._bus = None
            with suppress(can.CanError, OSError):
                bus.shutdown()

    def _read(self, bus: can.BusABC) -> None:
        receive, take, sink = bus.recv, self.receiver.take, self._sink
        arrived = Arrivals(self._patience.largest_age).of
        stopped, queries = self._stop.is_set, self.queries
        timeout = patience = self._patience.read
        while not stopped():
            if queries is not None:
                timeout = min(patience, queries.send_due(bus))
            try:
                message = receive(timeout)
            except MalformedPacketError:
                self.receiver.counts.malformed_packets += 1
                continue
            if message is None:
                continue
            for sample in take(message, arrived(message.timestamp)):
                sink(sample)
