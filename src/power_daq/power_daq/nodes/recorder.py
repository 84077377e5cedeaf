"""The recorder: writes the suite's topics to a bag, with a card."""

import shlex
import shutil
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final

from diagnostic_msgs.msg import DiagnosticArray
from power_recordings.card import NOTE
from power_recordings.messages.topics import message_class
from power_recordings.writing.background import BackgroundRecorder, RecordingProgress
from power_recordings.writing.metadata import CardFile
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from wattwalk_core.files import RecordingError
from wattwalk_core.nodes.diagnostics import Level, Report, Reporter
from wattwalk_core.nodes.polled_topic import PolledTopic

from power_daq.nodes.card_topic import subscribe_to_cards

_DEPTH: Final = 2000
_POWER: Final = ('drive_supply', 'supply')
_LOOK: Final = 0.01  # s between looks at the topics
_HOUSEKEEPING: Final = 0.2  # s
_LONGEST_NOTE: Final = 500  # characters


class RecorderNode(Node):
    """Puts the bytes of each message into the recorder, with the time of its publication.

    topics: their types by name. card: that of the folder `bag`. duration: s until the node ends
    by itself, 0 for never; with `wait` they count from the first sample of power on, and an end
    without one gives code 1.
    """

    def __init__(
        self,
        recorder: BackgroundRecorder,
        topics: dict[str, str],
        card: CardFile,
        bag: Path,
        duration: float,
        wait: bool = False,
    ) -> None:
        super().__init__('recorder')
        self.done: Future = Future()
        self._recorder = recorder
        self._card, self._bag, self._duration = card, bag, duration
        self._awaited = {self.resolve_topic_name(name) for name in _POWER} if wait else set()
        self._begun = 0.0
        self._best_effort: set[str] = set()
        self._types = {self.resolve_topic_name(name): topics[name] for name in topics}
        self._buffers = {
            name: self._subscribe(name, ReliabilityPolicy.RELIABLE) for name in self._types
        }
        self._taken = time.time_ns()
        subscribe_to_cards(self, card.add_source)
        self.create_subscription(DiagnosticArray, 'diagnostics', self._keep_notes, 10)
        self._before = recorder.progress()
        self._reporter = Reporter(self, 'bag')
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_HOUSEKEEPING, self._keep_house, clock=steady)
        self.create_timer(1.0, self._report, clock=steady)

    def poll(self) -> float:
        """Put what has come into the recorder; return the s until the next look."""
        since, now = self._taken, time.time_ns()
        for name, buffer in self._buffers.items():
            for cdr, published in buffer.take_with_source_time():
                # A publisher's clock may be another machine's.
                self._recorder.put(name, min(max(published, since), now), cdr)
        self._taken = now
        return _LOOK

    def _subscribe(self, name: str, reliability: ReliabilityPolicy) -> PolledTopic[bytes]:
        self._recorder.declare(name, self._types[name], reliability.name.lower())
        events = SubscriptionEventCallbacks(
            incompatible_qos=lambda _: self._best_effort.add(name), use_default_callbacks=False
        )
        kind = message_class(self._types[name])
        qos = QoSProfile(depth=_DEPTH, reliability=reliability)
        return PolledTopic[bytes](self, kind, name, qos, raw=True, events=events)

    def stop(self) -> int:
        """Close the bag, complete its card and print a summary.

        Return 1 for a bag without messages or, where it waits for samples, without any of power.
        Errors of closing are raised.
        """
        if sys.stdout.isatty():
            print()
        self.poll()
        recorder = self._recorder
        try:
            recorder.close()
        except BaseException:
            with suppress(RecordingError):
                self._card.add_drives(recorder.measured())
            raise
        self._card.add_drives(recorder.measured())
        print(f'{recorder.summary()}\n{self._bag}')
        progress = recorder.progress()
        if progress.counts:
            print(f'next: ros2 run power_recordings info {shlex.quote(str(self._bag))}')
        if progress.counts and self._waiting(progress):
            self.get_logger().error(f'no sample came on {" or ".join(sorted(self._awaited))}')
            return 1
        return 0 if progress.counts else 1

    def _waiting(self, progress: RecordingProgress) -> bool:
        return bool(self._awaited) and self._awaited.isdisjoint(progress.counts)

    def _keep_notes(self, message: DiagnosticArray) -> None:
        """Put notes of other nodes into the card."""
        stamp = message.header.stamp
        for status in message.status:
            for pair in status.values:
                if pair.key == NOTE:
                    at = stamp.sec * 1_000_000_000 + stamp.nanosec
                    self._card.add_mark(at, pair.value[:_LONGEST_NOTE])

    def _keep_house(self) -> None:
        if self._best_effort:
            self.poll()  # what waits would be lost with its subscription
        for name in sorted(self._best_effort):
            self.get_logger().warning(f'{name} is published best-effort: samples may be lost')
            self._buffers[name].destroy()
            self._buffers[name] = self._subscribe(name, ReliabilityPolicy.BEST_EFFORT)
        self._best_effort.clear()
        self._card.add_drives(self._recorder.measured())
        progress = self._recorder.progress()
        if self._waiting(progress):
            self._begun = progress.seconds
        over = self._duration and progress.seconds - self._begun >= self._duration
        if (over or self._recorder.failed) and not self.done.done():
            self.done.set_result(None)

    def _report(self) -> None:
        now = self._recorder.progress()
        rates = now.rates(self._before)
        self._before = now
        _show(now, rates, self.get_logger().info)
        level, sentence = Level.OK, 'recording'
        if not now.counts:
            level, sentence = Level.WARN, 'no message yet'
        if self._recorder.sequence.lost:
            level, sentence = Level.WARN, str(self._recorder.sequence)
        if now.dropped:
            level = Level.ERROR
            dropped = sum(now.dropped.values())
            sentence = f'{self._recorder.cause_of_drops}: {dropped} messages dropped'
        values = {f'{name} rate [Hz]': f'{rate:.1f}' for name, rate in rates.items()}
        values |= {f'{name} messages': str(count) for name, count in now.counts.items()}
        values |= {'size [B]': str(now.size), 'waiting [B]': str(now.waiting)}
        values['samples lost'] = str(self._recorder.sequence.lost)
        values['bag'] = str(self._bag.resolve())
        self._reporter.publish(Report(level, sentence, values))


def _show(now: RecordingProgress, rates: dict[str, float], log: Callable[..., None]) -> None:
    line = f'{now.seconds:6.1f} s  {now.size / 1e6:7.1f} MB  ' + '  '.join(
        f'{name.lstrip("/")} {rate:.0f} Hz' for name, rate in rates.items()
    )
    if sys.stdout.isatty():
        print(f'\r\x1b[K{line[: shutil.get_terminal_size().columns - 1]}', end='', flush=True)
    else:
        log(line, throttle_duration_sec=10.0)
