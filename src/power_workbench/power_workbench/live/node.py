"""The node of the live view: listens to the topics, reports notes on `diagnostics`."""

import time
from multiprocessing.connection import Connection
from typing import Final

from diagnostic_msgs.msg import DiagnosticArray
from power_recordings.card import NOTE
from power_recordings.messages.topics import TYPES, message_class
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from wattwalk_core.nodes.diagnostics import Level, Report, Reporter
from wattwalk_core.nodes.polled_topic import PolledTopic
from wattwalk_core.recent_power import REPORT

from power_workbench.live.follower import TOPICS, LiveFollower

_QOS = QoSProfile(depth=2000, reliability=ReliabilityPolicy.BEST_EFFORT)
_LOOK: Final = 0.05  # s between looks at the topics
_NEWS: Final = 0.1  # s between messages to the page
_FORGOTTEN: Final = 3.0  # s after its last report, when a recorder is taken to have ended
_RECORDER: Final = 'recorder: bag'


class LiveViewNode(Node):
    """Node that sends a follower's news over a pipe, and ends with the other end of it.

    It takes ('use', model, files of effects) and ('note', text) from the pipe. A note goes out at
    once with the node's report, for whoever records.
    """

    def __init__(self, pipe: Connection) -> None:
        super().__init__('workbench')
        self.done: Future = Future()
        self._pipe = pipe
        self._follower = LiveFollower(time.monotonic())
        self._topics = {
            topic: PolledTopic[bytes](self, message_class(TYPES[topic]), topic, _QOS, raw=True)
            for topic in TOPICS
        }
        self.create_subscription(DiagnosticArray, 'diagnostics', self._note_status, 10)
        self._recorder: tuple[float, str] = (-_FORGOTTEN, '')
        self._reporter = Reporter(self, 'live')
        self.create_timer(1.0, self._report, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._sent = 0.0

    def poll(self) -> float:
        """Take what has come from the topics and from the page; return the s until the next."""
        now = time.monotonic()
        for topic, waiting in self._topics.items():
            buffer = self._follower.buffers[topic]
            for cdr in waiting.take():
                buffer.take(cdr, now)
        try:
            while self._pipe.poll(0):
                order, *arguments = self._pipe.recv()
                if order == 'use':
                    self._follower.use(*arguments)
                else:
                    self._report({NOTE: arguments[0]})
            if now >= self._sent + _NEWS:
                self._sent = now
                at, bag = self._recorder
                recorder = bag if now - at < _FORGOTTEN else ''
                self._pipe.send({**self._follower.news(now), 'recorder': recorder})
        except (EOFError, OSError):
            if not self.done.done():
                self.done.set_result(None)
        return _LOOK

    def _report(self, figures: dict[str, str] | None = None) -> None:
        self._reporter.publish(Report(Level.OK, 'following', figures or {}))

    def _note_status(self, message: DiagnosticArray) -> None:
        for status in message.status:
            figures = {pair.key: pair.value for pair in status.values}
            if status.name == _RECORDER:
                self._recorder = (time.monotonic(), figures.get('bag', ''))
            elif status.name.endswith(REPORT):
                self._follower.report(figures, time.monotonic())
