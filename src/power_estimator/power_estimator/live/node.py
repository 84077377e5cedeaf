"""The live estimate: joint states and commands in, power of every drive out at 50 Hz."""

import argparse
import math
import time
from array import array
from pathlib import Path
from typing import Final

import numpy as np
from builtin_interfaces.msg import Time
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from wattwalk_core.errors import InputError
from wattwalk_core.nodes.diagnostics import FaultLog, Level, Report, Reporter
from wattwalk_core.nodes.parameters import DeviceParameters
from wattwalk_core.nodes.polled_topic import PolledTopic
from wattwalk_core.nodes.running import run_node

from drive_power_msgs.msg import DriveSupply, PowerEstimate
from power_estimator.live.change_watch import WatchConfig, WatchReference
from power_estimator.live.estimator import Estimate, LiveConfig
from power_estimator.live.score import measured_power
from power_estimator.live.session import LiveSession, Vector
from power_estimator.loader import load_model

_RELIABLE = ReliabilityPolicy.RELIABLE
_PERIOD: Final = 0.02  # s between estimates
_QUIET: Final = 0.017  # s after an estimate in which the next cannot be due
_AWAITED: Final = 0.001  # s between looks for its last joint state
_IDLE: Final = 0.005  # s between looks when estimates have stopped


class PowerEstimator(Node):
    """Publishes power_estimate and diagnostics; InputError for bad parameters or models."""

    def __init__(self) -> None:
        super().__init__('power_estimator')
        given = DeviceParameters(self)
        spec = given.text('model', '', 'power model: ppn:RUN or model.yaml')
        drives = given.text('drives', '', 'drives to estimate, with spaces; empty for all known')
        compare = given.flag('compare', False, 'compare with drive_supply, on diagnostics')
        stale = given.real('stale_after', 0.1, 's without joint_states until stale', 0.02, 10.0)
        timeout = given.real('command_timeout', 0.2, 's a command is held for', 0.01, 60.0)
        watch = given.flag('watch', False, 'compare drives with a reference, on diagnostics')
        kept = given.text('reference', '', 'file of the reference; learned where there is none')
        rate = given.real('false_alarms_per_month', 1.0, 'of motion, by watch', 1e-3, 1e3)
        minutes = given.real('reference_minutes', 30.0, 'of motion that are learned', 5.0, 600.0)
        if not spec:
            raise InputError('parameter model is empty; give -p model:=ppn:RUN or a model.yaml')
        self._model = spec
        model = load_model(spec)
        wanted = WatchConfig(rate, minutes) if watch else None
        self._kept = Path(kept) if watch and kept else None
        known = None
        if self._kept is not None and wanted is not None:
            known = WatchReference.load(self._kept, model.name, wanted.block)
        self._learned = known is not None
        self._session = LiveSession(
            model,
            watch=wanted,
            reference=None if known is None else known.drives,
            wanted=drives.split(),
            stale_after=stale,
            config=LiveConfig(command_timeout=timeout),
        )
        qos = QoSProfile(depth=1000, reliability=_RELIABLE)
        self._estimates = self.create_publisher(
            PowerEstimate, 'power_estimate', QoSProfile(depth=10, reliability=_RELIABLE)
        )
        self._reporter = Reporter(self, 'estimate')
        self._budget_reporter = Reporter(self, 'budget')
        self._faults = FaultLog(self.get_logger())
        self._watch_reporter = Reporter(self, 'watch') if watch else self._reporter
        topics = self._session.topics
        self._targets = (
            PolledTopic[JointState](self, JointState, 'joint_commands', qos)
            if 'joint_commands' in topics
            else None
        )
        self._states = PolledTopic[JointState](self, JointState, 'joint_states', qos)
        self._measured = (
            PolledTopic[DriveSupply](self, DriveSupply, 'drive_supply', qos)
            if compare or watch or 'drive_supply' in topics
            else None
        )
        self.create_timer(1.0, self._diagnose, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._said = ''
        self._sent = -math.inf

    def poll(self) -> float:
        """Take what has come, publish the estimate that is due; return the s until the next."""
        # Commands first: they hold from their stamps on, whenever they came.
        for message in self._targets.take() if self._targets else ():
            self._on_command(message)
        for message in self._states.take():
            self._on_state(message)
        if self._measured is not None:
            for message in self._measured.take():
                self._on_supply(message)
        now = time.monotonic()
        stale = self._session.stale(now) if now >= self._sent + _PERIOD else None
        if stale is not None:
            self._publish(stale)
        since = now - self._sent
        if since < _QUIET:
            return _QUIET - since
        return _AWAITED if since < 2 * _PERIOD else _IDLE

    def _on_command(self, message: JointState) -> None:
        targets = message.position if len(message.position) else [np.nan] * len(message.name)
        if len(targets) == len(message.name):
            values = np.array(targets, float)[None]
            vector = Vector(_ns(message.header.stamp), tuple(message.name), values)
            self._session.command(vector, time.monotonic())

    def _on_state(self, message: JointState) -> None:
        rows = (message.position, message.velocity, message.effort)
        if any(len(row) != len(message.name) for row in rows):
            self._faults.warning(
                'joint_states without position, velocity and effort of every joint'
            )
            return
        vector = Vector(_ns(message.header.stamp), tuple(message.name), np.array(rows, float))
        estimate = self._session.joint_state(vector, time.monotonic())
        if estimate is not None:
            self._publish(estimate)
            now = self.get_clock().now().nanoseconds
            self._session.sent((now - estimate.stamp) / 1e9)

    def _on_supply(self, message: DriveSupply) -> None:
        try:
            power = measured_power(
                len(message.name), message.voltage, message.current, message.status
            )
        except ValueError as error:
            self._faults.warning(f'drive_supply: {error}')
            return
        names, stamp = tuple(message.name), _ns(message.header.stamp)
        self._session.supply(Vector(stamp, names, power))
        last = np.full((2, len(names)), np.nan)
        last[0] = message.voltage[-len(names) :]
        if len(message.temperature) == len(names):
            last[1] = message.temperature
        self._session.electrical(Vector(stamp, names, last), time.monotonic())

    def _publish(self, estimate: Estimate) -> None:
        self._sent = time.monotonic()
        message = PowerEstimate(
            model=self._model,
            name=list(self._session.drives),
            power=array('f', estimate.power.astype(np.float32).tobytes()),
            total=estimate.total,
            status=int(estimate.status),
        )
        message.header.stamp = Time(
            sec=estimate.stamp // 1_000_000_000, nanosec=estimate.stamp % 1_000_000_000
        )
        self._estimates.publish(message)

    def _diagnose(self) -> None:
        well, sentence, figures = self._session.report(time.monotonic())
        if sentence != self._said:
            if well:
                self.get_logger().info(sentence)
            else:
                self.get_logger().warning(sentence)
            self._said = sentence
        _publish_report(self._reporter, well, sentence, figures)
        self._budget_reporter.publish(Report(Level.OK, *self._session.budget.report()))
        self._watch()

    def _watch(self) -> None:
        """Test what was measured since the last report; keep the reference once it is known."""
        found, watch = self._session.watched(), self._session.watch
        if watch is None:
            return
        if found is not None:
            self.get_logger().warning(found.sentence)
        _publish_report(self._watch_reporter, *watch.report())
        if watch.reference is not None and not self._learned:
            self._learned = True
            if self._kept is not None:
                own = WatchReference(
                    'watch_reference/1', self._session.model, watch.config.block, watch.reference
                )
                own.save(self._kept)


def _publish_report(
    reporter: Reporter, well: bool, sentence: str, figures: dict[str, str]
) -> None:
    reporter.publish(Report(Level.OK if well else Level.WARN, sentence, figures))


def _ns(stamp: Time) -> int:
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def run(options: argparse.Namespace) -> int:
    """Run the node until Ctrl-C; 2 for bad parameters or a model that cannot be loaded."""
    return run_node(PowerEstimator, options.ros_args)
