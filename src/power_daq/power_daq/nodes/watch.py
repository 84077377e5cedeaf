"""The live view of a running measurement in the terminal."""

import argparse
import time
from collections.abc import Callable
from typing import Final

from diagnostic_msgs.msg import DiagnosticArray
from power_recordings.messages.topics import TYPES, message_class
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from wattwalk_core.nodes.polled_topic import PolledTopic
from wattwalk_core.nodes.running import run_node

from power_daq.monitor.screen import Terminal
from power_daq.monitor.state import TOPICS, MonitorState, View

_QOS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
_LOOK: Final = 0.05  # s between looks at the topics


class WatchNode(Node):
    """Shows a view of the measurement each `period` s, for `duration` s; 0: without end."""

    def __init__(
        self, show: Callable[[View], None], period: float, duration: float, battery: float
    ) -> None:
        """battery: energy in it at the start, Wh, NaN where it is not known."""
        super().__init__('watch')
        self.done: Future = Future()
        self._show = show
        self._duration = duration
        self._state = MonitorState(time.monotonic(), battery)
        self._topics = {
            topic: PolledTopic[bytes](self, message_class(TYPES[topic]), topic, _QOS, raw=True)
            for topic in TOPICS
            if topic != 'diagnostics'
        }
        self.create_subscription(DiagnosticArray, 'diagnostics', self._note_status, _QOS)
        self.create_timer(period, self._refresh, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def poll(self) -> float:
        """Keep the messages that have come; return the s until the next look."""
        for topic, waiting in self._topics.items():
            source = self._state.source(topic)
            for cdr in waiting.take():
                source.take(cdr, time.monotonic())
        return _LOOK

    def _note_status(self, message: DiagnosticArray) -> None:
        now = time.monotonic()
        self._state.source('diagnostics').take(b'', now)
        for status in message.status:
            level = status.level[0] if isinstance(status.level, bytes) else int(status.level)
            figures = {pair.key: pair.value for pair in status.values}
            self._state.report(status.name, level, status.message, figures, now)

    def _refresh(self) -> None:
        view = self._state.view(time.monotonic())
        self._show(view)
        if self._duration and view.seconds >= self._duration and not self.done.done():
            self.done.set_result(None)


def run(options: argparse.Namespace) -> None:
    """Watch until Ctrl-C or the end of the duration; 2 for bad input."""
    terminal = Terminal()

    def make() -> WatchNode:
        node = WatchNode(terminal.show, terminal.period, options.duration, options.battery)
        terminal.start()
        return node

    try:
        run_node(make, options.ros_args)
    finally:
        terminal.stop()
    if options.save is not None:
        terminal.save(options.save)
        print(options.save)
