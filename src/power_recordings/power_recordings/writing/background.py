"""A thread that writes messages to a bag, so that a slow disk delays nothing."""

import struct
import time
from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass

from wattwalk_core.worker import Worker

from power_recordings.messages.cdr import DRIVE_SUPPLY, deserialize
from power_recordings.writing.writer import BagWriter

_WAITING = 64 << 20  # bytes
_PERIOD = 0.05  # s
_FLUSH_PERIOD = 0.5  # s


@dataclass
class SequenceCheck:
    """Counts samples, lost samples and gaps (`places`) of DriveSupply by sequence number."""

    samples: int = 0
    lost: int = 0
    places: int = 0
    _expected: int | None = None

    def feed(self, cdr: bytes) -> None:
        """Count the samples of a message (CDR bytes), and those lost before it.

        A truncated one is ignored.
        """
        try:
            order = '<' if cdr[1] == 1 else '>'
            (frame,) = struct.unpack_from(f'{order}I', cdr, 12)
            start = 4 + (12 + frame + 7) // 8 * 8
            first, count = struct.unpack_from(f'{order}QI', cdr, start)
        except (IndexError, struct.error):
            return
        if self._expected is not None and first != self._expected:
            self.places += 1
            self.lost += max(first - self._expected, 0)
        self.samples += count
        self._expected = first + count

    def __str__(self) -> str:
        if not self.places:
            return f'all {self.samples} samples of drive_supply came'
        return (
            f'drive_supply lost {self.lost} samples in {self.places} places ({self.samples} came)'
        )


@dataclass(frozen=True)
class RecordingProgress:
    """Progress of a recording; seconds: since its start."""

    seconds: float
    counts: Mapping[str, int]  # messages written, by topic
    dropped: Mapping[str, int]  # messages for which there was no room, by topic
    size: int  # bytes in the file
    waiting: int  # bytes that the disk has not taken yet
    begun: Mapping[str, float]  # s at which the first message of each topic was taken

    def rates(self, before: 'RecordingProgress') -> dict[str, float]:
        """Return messages per second by topic since an earlier progress or the first message."""
        rates = {}
        for name, count in self.counts.items():
            since = max(before.seconds, self.begun[name])
            # The first message ends no period.
            fresh = count - before.counts.get(name, 1)
            rates[name] = fresh / max(self.seconds - since, 1e-9)
        return rates


class BackgroundRecorder(Worker):
    """A bag and the thread that writes it.

    Up to 64 MiB wait for the disk; further messages are dropped and counted. Messages are with
    the operating system within half a second. A topic is declared in the bag with its first
    message.
    """

    def __init__(self, bag: BagWriter, most_waiting: int = _WAITING):
        super().__init__('bag writer')
        self._bag = bag
        self._declared: dict[str, tuple[str, str]] = {}  # type and reliability
        self._topics: dict[str, int] = {}
        self._queue: deque[tuple[str, int, bytes]] = deque()
        self._most = most_waiting
        self._taken = self._written = 0
        self._counts: Counter[str] = Counter()
        self._dropped: Counter[str] = Counter()
        self._started = time.monotonic()
        self._begun: dict[str, float] = {}
        self._supply: bytes | None = None
        self.sequence = SequenceCheck()
        self.start()

    def put(self, name: str, log_time_ns: int, cdr: bytes) -> None:
        """Queue a message (CDR bytes) of a declared topic without waiting for the disk."""
        if self.failed or self._taken - self._written > self._most:
            self._dropped[name] += 1
            return
        self._taken += len(cdr)
        self._begun.setdefault(name, time.monotonic() - self._started)
        self._queue.append((name, log_time_ns, cdr))

    def declare(self, name: str, type_name: str, reliability: str = 'reliable') -> None:
        """Set type and reliability of a topic, before its first message."""
        self._declared[name] = type_name, reliability

    def progress(self) -> RecordingProgress:
        """Return the progress now."""
        return RecordingProgress(
            time.monotonic() - self._started,
            dict(self._counts),
            dict(self._dropped),
            self._bag.size,
            self._taken - self._written,
            dict(self._begun),
        )

    @property
    def cause_of_drops(self) -> str:
        """Reason why messages are dropped, as text."""
        return f'writing failed ({self._error})' if self.failed else 'the disk was too slow'

    def summary(self) -> str:
        """Return counts, rates and losses, a line each."""
        end = self.progress()
        rates = end.rates(RecordingProgress(0.0, {}, {}, 0, 0, {}))
        lines = [
            f'{name:<24}{count:>10} messages{rates[name]:>10.1f} Hz'
            for name, count in sorted(end.counts.items())
        ]
        if self.sequence.samples:
            lines.append(str(self.sequence))
        lines += [
            f'{count} messages of {name} were dropped: {self.cause_of_drops}'
            for name, count in end.dropped.items()
        ]
        if not end.counts:
            lines.append('no message came on any topic: is anything running?')
        return '\n'.join([*lines, f'{end.seconds:.1f} s, {end.size / 1e6:.1f} MB'])

    def measured(self) -> tuple[str, ...]:
        """Return the drives in the first message of drive_supply; empty before that."""
        return () if self._supply is None else tuple(deserialize(DRIVE_SUPPLY, self._supply).name)

    def close(self) -> None:
        """Write waiting messages and close the bag; raises what ended the writing before that."""
        self.stop()
        try:
            self.join()
        except Exception as error:
            written, lost = sum(self._counts.values()), len(self._queue) + self._dropped.total()
            error.add_note(f'{self._bag.path}: {written} messages written, {lost} lost')
            raise
        finally:
            self._bag.close()

    def _work(self) -> None:
        flushed = time.monotonic()
        while True:
            stopping = self._stop.wait(_PERIOD)
            self._drain()
            if time.monotonic() - flushed >= _FLUSH_PERIOD:
                self._bag.flush()
                flushed = time.monotonic()
            if stopping:
                return

    def _drain(self) -> None:
        while self._queue:
            name, log_time_ns, cdr = self._queue[0]
            if name not in self._topics:
                self._topics[name] = self._bag.add_topic(name, *self._declared[name])
            if self._declared[name][0] == DRIVE_SUPPLY:
                self.sequence.feed(cdr)
                self._supply = self._supply or cdr
            self._bag.write(self._topics[name], log_time_ns, cdr)
            self._queue.popleft()
            self._counts[name] += 1
            self._written += len(cdr)
