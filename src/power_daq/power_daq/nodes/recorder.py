"""The recorder: writes the suite's topics to a bag, with a card."""

import argparse
import shutil
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from power_recordings.card import Card
from power_recordings.writing.background import BackgroundRecorder, RecordingProgress
from power_recordings.writing.writer import BagWriter
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from rclpy.utilities import remove_ros_args
from wattwalk_core.command import command
from wattwalk_core.errors import InputError
from wattwalk_core.files import check_room
from wattwalk_core.nodes.diagnostics import Level, Report, Reporter
from wattwalk_core.nodes.running import run_node

from power_daq.nodes.recorder_options import card_of, message_class, topics_of

_DEPTH = 2000
_HOUSEKEEPING = 0.2  # s
_EXAMPLE = """
example, until Ctrl-C:
  ros2 run power_daq record -o bags/walk_1 --card robot=anymal_c unit=A terrain=flat
example, one minute of two topics:
  ros2 run power_daq record -o bags/leg --duration 60 --topics drive_supply joint_states
"""


class RecorderNode(Node):
    """
    Puts the bytes of each message into the recorder as it arrives.

    topics: their types by name. card: what the user says of the recording, to be completed and
    saved in the folder `bag` at the end. duration: s until the node ends by itself, 0 for never.
    """

    def __init__(
        self,
        recorder: BackgroundRecorder,
        topics: dict[str, str],
        card: Card,
        bag: Path,
        duration: float,
    ) -> None:
        super().__init__('recorder')
        self.done: Future = Future()
        self._recorder = recorder
        self._card, self._bag, self._duration = card, bag, duration
        self._best_effort: set[str] = set()
        self._types = {self.resolve_topic_name(name): topics[name] for name in topics}
        self._subscriptions_by_topic = {
            name: self._subscribe(name, ReliabilityPolicy.RELIABLE) for name in self._types
        }
        self._calibrations: dict[str, None] = {}
        self.create_subscription(DiagnosticArray, 'diagnostics', self._note_calibration, 10)
        self._before = recorder.progress()
        self._reporter = Reporter(self, 'bag')
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_HOUSEKEEPING, self._keep_house, clock=steady)
        self.create_timer(1.0, self._report, clock=steady)

    def _subscribe(self, name: str, reliability: ReliabilityPolicy) -> Any:
        self._recorder.declare(name, self._types[name], reliability.name.lower())
        events = SubscriptionEventCallbacks(
            incompatible_qos=lambda _: self._best_effort.add(name), use_default_callbacks=False
        )
        return self.create_subscription(
            message_class(self._types[name]),
            name,
            partial(_take, self._recorder.put, name),
            QoSProfile(depth=_DEPTH, reliability=reliability),
            raw=True,
            event_callbacks=events,
        )

    def stop(self) -> int:
        """Close the bag, complete its card and print a summary; 1 for a bag without messages."""
        if sys.stdout.isatty():
            print()
        recorder = self._recorder
        recorder.close()
        applied = ', '.join(self._calibrations)
        self._card.with_drives(recorder.measured()).with_calibration(applied).save(self._bag)
        print(f'{recorder.summary()}\n{self._bag}')
        return 0 if recorder.progress().counts else 1

    def _note_calibration(self, message: DiagnosticArray) -> None:
        for status in message.status:
            for pair in status.values:
                if pair.key == 'calibration':
                    self._calibrations[pair.value] = None

    def _keep_house(self) -> None:
        for name in sorted(self._best_effort):
            self.get_logger().warning(f'{name} is published best-effort: samples may be lost')
            self.destroy_subscription(self._subscriptions_by_topic[name])
            self._subscriptions_by_topic[name] = self._subscribe(
                name, ReliabilityPolicy.BEST_EFFORT
            )
        self._best_effort.clear()
        over = self._duration and self._recorder.progress().seconds >= self._duration
        if (over or self._recorder.failed is not None) and not self.done.done():
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
            sentence = f'the disk is too slow: {sum(now.dropped.values())} messages dropped'
        values = {f'{name} rate [Hz]': f'{rate:.1f}' for name, rate in rates.items()}
        values |= {f'{name} messages': str(count) for name, count in now.counts.items()}
        values |= {'size [B]': str(now.size), 'waiting [B]': str(now.waiting)}
        values['samples lost'] = str(self._recorder.sequence.lost)
        self._reporter.publish(Report(level, sentence, values))


def _take(put: Callable[[str, int, bytes], None], name: str, cdr: bytes) -> None:
    put(name, time.time_ns(), cdr)


def _show(now: RecordingProgress, rates: dict[str, float], log: Callable[..., None]) -> None:
    line = f'{now.seconds:6.1f} s  {now.size / 1e6:7.1f} MB  ' + '  '.join(
        f'{name.lstrip("/")} {rate:.0f} Hz' for name, rate in rates.items()
    )
    if sys.stdout.isatty():
        print(f'\r\x1b[K{line[: shutil.get_terminal_size().columns - 1]}', end='', flush=True)
    else:
        log(line, throttle_duration_sec=10.0)


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog='ros2 run power_daq record',
        description="Records the suite's topics to a rosbag2 MCAP bag, until Ctrl-C.",
        epilog=_EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        '-o', '--output', type=Path, required=True, metavar='BAG', help='new folder of the bag'
    )
    parser.add_argument(
        '--topics', nargs='+', metavar='TOPIC', help='instead of all: NAME or NAME:package/Type'
    )
    parser.add_argument('--duration', type=float, default=0.0, metavar='S', help='stop after that')
    parser.add_argument(
        '--card',
        nargs='+',
        action='extend',
        default=[],
        metavar='KEY=VALUE',
        help='robot, unit, drives, controller, calibration, terrain, notes, … for card.yaml',
    )
    options = parser.parse_args(remove_ros_args(list(arguments)))
    if options.duration < 0:
        raise InputError(f'--duration is {options.duration:g} s; expected a positive number')
    return options


@command
def main(args: Sequence[str] | None = None) -> int:
    """Record until Ctrl-C or the end of the duration; 2 for bad input or a full disk."""
    arguments = sys.argv[1:] if args is None else list(args)
    options = _parse(arguments)
    card = card_of(options.card)
    topics = topics_of(options.topics)
    for type_name in topics.values():
        message_class(type_name)

    def make() -> RecorderNode:
        check_room(options.output)
        bag = BagWriter(options.output, flush_period=10.0)
        card.save(options.output)
        recorder = BackgroundRecorder(bag)
        try:
            node = RecorderNode(recorder, topics, card, options.output, options.duration)
        except BaseException:
            recorder.close()
            raise
        print(f'recording to {options.output}; Ctrl-C ends it', flush=True)
        return node

    return run_node(make, arguments)
