"""Puts a drive through a motion, records it, files the recording and checks it: one command."""

import argparse
import signal
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from policy_runner.nodes.run_options import command
from rclpy.clock import Clock, ClockType
from rclpy.executors import ExternalShutdownException
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args
from wattwalk_core.errors import InputError
from wattwalk_core.nodes.running import interrupt_on_signals

from drive_bench.motion.file import MotionFile
from drive_bench.nodes.bench_options import bag_of, card_of, parse
from drive_bench.nodes.excite import ExciteNode
from drive_bench.nodes.excite_options import motion_of
from drive_bench.run.filing import file_away
from drive_bench.run.motion_run import ExcitationRun
from drive_bench.run.recorder_process import NAME, RecorderProcess, check_new

_NEEDED = ('drive_supply', 'joint_states')
_LEAD = 1.0  # s that are recorded before the drive moves
_SPARE = 600.0  # s that a recorder outlasts its motion at most, should nobody end it


class BenchNode(ExciteNode):
    """Starts the recorder once all is there, the motion once that records, and watches both."""

    offered: ClassVar = {
        name: action for name, action in ExciteNode.offered.items() if name != 'start'
    }

    def __init__(self, options: argparse.Namespace, motion: MotionFile) -> None:
        super().__init__(options, motion)
        self.recorder: RecorderProcess | None = None
        self._began = time.monotonic()
        self._counts: dict[str, int] = {}
        self._recording_since: float | None = None
        self._moved = False
        self.create_subscription(DiagnosticArray, 'diagnostics', self._on_diagnostics, 10)
        self.create_timer(0.1, self._advance, clock=Clock(clock_type=ClockType.STEADY_TIME))

    @property
    def run(self) -> ExcitationRun | None:
        """The motion, once joint_states came."""
        return self._run

    def _introduction(self, run: ExcitationRun) -> str:
        return f'{run.motion.name}: {run.motion.seconds:.0f} s of {", ".join(run.drives)}'

    def _progress(self, run: ExcitationRun) -> str:
        return run.progress if run.active else run.reason

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == f'{NAME}: bag':
                self._counts = {
                    pair.key.removesuffix(' messages').rsplit('/', 1)[-1]: int(pair.value)
                    for pair in status.values
                    if pair.key.endswith(' messages')
                }

    def _advance(self) -> None:
        if self.recorder is None:
            self._wait_for_topics()
        elif self.recorder.ended:
            self._recorder_ended(self.recorder.ended)
        elif not self._moved:
            self._wait_for_recorder()

    def _wait_for_topics(self) -> None:
        lacking = self._lacking()
        run = self._run
        if lacking or run is None or run.unsound(self._now()):
            why = lacking or (run.unsound(self._now()) if run else '')
            if time.monotonic() - self._began > self._options.patience:
                raise InputError(
                    f'{why} within {self._options.patience:g} s; is ros2 run power_daq daq '
                    'running, and the drive on?'
                )
            self.get_logger().info(f'waiting: {why}', throttle_duration_sec=5.0)
            return
        run.plan()
        bag = bag_of(self._options, run.motion, run.drives)
        check_new(bag)
        longest = 2.0 * run.exciting.left + _SPARE
        where = [] if self.get_namespace() == '/' else ['-r', f'__ns:={self.get_namespace()}']
        self.recorder = RecorderProcess(
            bag, card_of(self._options, run.motion, run.drives), longest, where
        )
        self._began = time.monotonic()

    def _lacking(self) -> str:
        if self._run is None:
            return 'joint_states never came'
        if not self.count_publishers('drive_supply'):
            return 'nobody publishes drive_supply'
        return ''

    def _wait_for_recorder(self) -> None:
        now = time.monotonic()
        if not all(self._counts.get(topic) for topic in _NEEDED):
            if now - self._began > self._options.patience:
                missing = [topic for topic in _NEEDED if not self._counts.get(topic)]
                raise InputError(f'the recorder hears nothing of {", ".join(missing)}')
            return
        self._recording_since = self._recording_since or now
        run = self._run
        if run is None or now - self._recording_since < _LEAD:
            return
        self._moved = True
        started, told = run.start(self._now())
        if not started:
            raise InputError(told)

    def _recorder_ended(self, why: str) -> None:
        if not self._moved:
            raise InputError(why)
        if self._run is not None:
            self._run.monitor.interlock = why


@command
def main(arguments: Sequence[str]) -> int:
    """Run a motion with its recording; the drives are damped when it ends."""
    options = parse(remove_ros_args(list(arguments)))
    motion = motion_of(options)
    if options.output is not None:
        check_new(Path(options.output))
    rclpy.init(args=list(arguments), signal_handler_options=SignalHandlerOptions.NO)
    interrupt_on_signals()
    node, code, why = None, 1, 'ended before it began'
    try:
        node = BenchNode(options, motion)
        rclpy.spin_until_future_complete(node, node.done)
        code = int(node.done.result())
    except (KeyboardInterrupt, ExternalShutdownException):
        code = 130
    except InputError as error:
        why = str(error)
        raise
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        if node is not None:
            node.damp()
            run, recorder = node.run, node.recorder
            node.destroy_node()
            if run is not None and recorder is not None:
                reason = run.reason if run.code is not None else why
                code = max(code, file_away(run, recorder, reason, options, sys.stdout))
        rclpy.try_shutdown()
    return code
