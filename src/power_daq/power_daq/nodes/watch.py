"""The live view of a running measurement in the terminal."""

import argparse
import io
import re
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from diagnostic_msgs.msg import DiagnosticArray
from power_recordings.messages.topics import TYPES
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from rclpy.utilities import remove_ros_args
from rich.console import Console
from rich.live import Live
from wattwalk_core.command import command
from wattwalk_core.errors import InputError
from wattwalk_core.files import write_whole
from wattwalk_core.nodes.running import run_node

from power_daq.monitor.screen import Screen, line
from power_daq.monitor.state import TOPICS, MonitorState, View
from power_daq.nodes.recorder_options import message_class

_PERIOD, _LINE_PERIOD = 0.5, 1.0  # s
_QOS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
_EXAMPLE = """
On a terminal it is a screen of 80 columns or more, twice a second; into a pipe or a file it is a
line a second. It asks nothing of the nodes it watches: it may come and go at any time.

examples:
  ros2 run power_daq watch
  ros2 run power_daq watch --duration 10 --save now.svg
  ros2 run power_daq watch > watch.log
"""


class WatchNode(Node):
    """Keeps the bytes of messages and shows a view of them periodically."""

    def __init__(self, show: Callable[[View], None], period: float, duration: float) -> None:
        super().__init__('watch')
        self.done: Future = Future()
        self._show = show
        self._duration = duration
        self._state = MonitorState(time.monotonic())
        for topic in TOPICS:
            if topic != 'diagnostics':
                kind = message_class(TYPES[topic])
                take = partial(_take, self._state.source(topic).take)
                self.create_subscription(kind, topic, take, _QOS, raw=True)
        self.create_subscription(DiagnosticArray, 'diagnostics', self._note_status, _QOS)
        self.create_timer(period, self._refresh, clock=Clock(clock_type=ClockType.STEADY_TIME))

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


def _take(take: Callable[[bytes, float], None], cdr: bytes) -> None:
    take(cdr, time.monotonic())


def _now() -> str:
    return time.strftime('%H:%M:%S')


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog='ros2 run power_daq watch',
        description='Shows what a running measurement measures: watts of each drive, the '
        'supply, energy, estimates, losses, clocks, the bus and the recorder.',
        epilog=_EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('--duration', type=float, default=0.0, metavar='S', help='end after that')
    parser.add_argument(
        '--save', type=Path, metavar='F.svg', help='at the end, write the last view as a picture'
    )
    options = parser.parse_args(remove_ros_args(list(arguments)))
    if not options.duration >= 0:
        raise InputError(f'--duration is {options.duration:g} s; expected a positive number')
    if options.save is not None and options.save.suffix != '.svg':
        raise InputError(f'--save is {options.save}; expected a name that ends with .svg')
    return options


def _save(path: Path, screen: Screen) -> None:
    recorder = Console(record=True, width=80, file=io.StringIO(), force_terminal=True)
    recorder.print(screen)
    picture = recorder.export_svg(title='ros2 run power_daq watch')
    own_fonts = re.sub(r'@font-face \{.*?\}', '', picture, flags=re.DOTALL)
    write_whole(path, own_fonts.replace('Fira Code', 'DejaVu Sans Mono, Menlo, Consolas'))


@command
def main(args: Sequence[str] | None = None) -> int:
    """Watch until Ctrl-C or the end of the duration; 2 for bad input."""
    arguments = sys.argv[1:] if args is None else list(args)
    options = _parse(arguments)
    console, screen = Console(), Screen()
    on_screen = console.is_terminal and not console.is_dumb_terminal
    last: list[View] = []
    live = Live(screen, console=console, screen=True, auto_refresh=False)

    def show(view: View) -> None:
        last[:] = [view]
        screen.update(view, _now())
        if on_screen:
            live.refresh()
        else:
            print(line(view, _now()), flush=True)

    def make() -> WatchNode:
        node = WatchNode(show, _PERIOD if on_screen else _LINE_PERIOD, options.duration)
        if on_screen:
            live.start()
        return node

    try:
        run_node(make, arguments)
    finally:
        live.stop()
    if on_screen and last:
        print(line(last[0], _now()))
    if options.save is not None:
        _save(options.save, screen)
        print(options.save)
    return 0
