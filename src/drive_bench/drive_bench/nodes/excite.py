"""Node that puts drives through a motion file: joint states in, joint commands out."""

import argparse
from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from policy_runner.nodes.parameters import real_parameter
from policy_runner.nodes.run_options import InputError, command
from policy_runner.supervisor.safety import SafetyConfig
from rclpy.clock import Clock, ClockType
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rclpy.utilities import remove_ros_args
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from wattwalk_core.nodes.running import interrupt_on_signals

from drive_bench.motion.file import MotionFile
from drive_bench.motion.joint_limits import limits_of
from drive_bench.nodes.excite_options import motion_of, mounting_of, parse
from drive_bench.nodes.messages import command_message, diagnosis, run_of
from drive_bench.run.motion_player import Exciting
from drive_bench.run.motion_run import Command, ExcitationRun
from drive_power_msgs.msg import DriveSupply

_SENSORS = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
_COMMANDS = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
_AFTERWARDS = 1.0  # s of damping before the node ends
_STEADY = ClockType.STEADY_TIME


class ExciteNode(Node):
    """
    Feeds the run of a motion from joint_states and sends what it gives.

    offered: what others may call, by name.
    """

    offered: ClassVar[Mapping[str, Callable[[ExcitationRun, float], tuple[bool, str]]]] = {
        'start': ExcitationRun.start,
        'stop': ExcitationRun.stop,
        'estop': ExcitationRun.emergency_stop,
    }

    def __init__(self, options: argparse.Namespace, motion: MotionFile) -> None:
        super().__init__('policy_runner')
        self._options, self._motion = options, motion
        self._drives = tuple(dict.fromkeys(options.drive or motion.drives[:1]))
        if not self._drives:
            raise InputError(f'{options.motion} names no drive; give --drive NAME')
        mounting_of(options)
        limits_of(self._drives, options.limits)
        rate = real_parameter(self, 'rate', Exciting.rate, 50.0, 400.0, 'Hz of joint_commands')
        stale = real_parameter(
            self, 'stale_after', 0.06, 0.01, 1.0, 's; older joint_states: damping'
        )
        self._config = SafetyConfig(stale_after=stale)
        self._start_wanted: bool = getattr(options, 'start', False)
        self._run: ExcitationRun | None = None
        self._over: float | None = None
        self._told, self._noted = '', 0
        self.done: Future = Future()
        simulated = bool(self.get_parameter('use_sim_time').value)
        self._time = self.get_clock() if simulated else Clock(clock_type=_STEADY)
        self._commands = self.create_publisher(JointState, 'joint_commands', _COMMANDS)
        self._diagnostics = self.create_publisher(DiagnosticArray, 'diagnostics', 10)
        self.create_subscription(JointState, 'joint_states', self._on_joints, _SENSORS)
        if motion.warms:
            self.create_subscription(DriveSupply, 'drive_supply', self._on_supply, _SENSORS)
        for name, action in self.offered.items():
            self._service(name, action)
        self.create_timer(1.0 / rate, self._step, clock=self._time)
        self.create_timer(1.0, self._look_around, clock=Clock(clock_type=_STEADY))

    @property
    def active(self) -> bool:
        """Whether drives are being moved."""
        return self._run is not None and self._run.active

    def damp(self) -> None:
        """Send a last damping command if drives are being moved, and say that it was asked for."""
        if self._run is not None and self._run.active:
            self._run.stop(self._now())
            self._send(self._run.damping)
            self._announce(self._run)

    def _service(
        self, name: str, action: Callable[[ExcitationRun, float], tuple[bool, str]]
    ) -> None:
        def serve(request: Trigger.Request, answer: Trigger.Response) -> Trigger.Response:
            if self._run is None:
                answer.success, answer.message = False, 'joint_states never came'
                if name != 'start':
                    self._start_wanted = False
                return answer
            self._start_wanted = False
            self._run.count_publishers(self.count_publishers('joint_commands'))
            answer.success, answer.message = action(self._run, self._now())
            return answer

        self.create_service(Trigger, name, serve)

    def _now(self) -> float:
        return float(self._time.now().nanoseconds) * 1e-9

    def _on_joints(self, message: JointState) -> None:
        if self._run is None:
            self._run = run_of(message, self._motion, self._drives, self._options, self._config)
            self._run.count_publishers(self.count_publishers('joint_commands'))
            self.get_logger().info(self._introduction(self._run))
        stamp = int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)
        self._run.inputs.on_joint_states(
            stamp, message.name, message.position, message.velocity, message.effort, self._now()
        )

    def _progress(self, run: ExcitationRun) -> str:
        return run.progress

    def _introduction(self, run: ExcitationRun) -> str:
        return run.introduction

    def _on_supply(self, message: DriveSupply) -> None:
        if self._run is not None:
            windings = self._run.exciting.windings
            windings.on_supply(message.name, message.temperature, self._now())

    def _step(self) -> None:
        run, now = self._run, self._now()
        if run is None:
            return
        if self._start_wanted and run.start(now)[0]:
            self._start_wanted = False
        to_send = run.update(now)
        if to_send is not None:
            self._send(to_send)
        self._announce(run)
        if run.code is not None:
            self._over = now if self._over is None else self._over
            if now - self._over >= _AFTERWARDS and not self.done.done():
                self.done.set_result(run.code)

    def _send(self, to_send: Command) -> None:
        stamp = self.get_clock().now().to_msg()
        self._commands.publish(command_message(to_send, stamp))

    def _announce(self, run: ExcitationRun) -> None:
        while self._noted < len(run.notes):
            self.get_logger().warning(f'fitted: {run.notes[self._noted]}')
            self._noted += 1
        reason = run.reason
        if reason == self._told:
            return
        self._told = reason
        if run.code == 1:
            self.get_logger().error(f'damping, {reason}')
        else:
            self.get_logger().info(self._progress(run))
        self._diagnose(run)

    def _look_around(self) -> None:
        if self._run is None:
            self.get_logger().info('waiting for joint_states', throttle_duration_sec=10.0)
            return
        self._run.count_publishers(self.count_publishers('joint_commands'))
        if self._start_wanted and (why := self._run.unsound(self._now())):
            self.get_logger().info(f'waiting: {why}', throttle_duration_sec=5.0)
        self._diagnose(self._run)

    def _diagnose(self, run: ExcitationRun) -> None:
        stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(diagnosis(run, self._now(), stamp))


@command
def main(arguments: Sequence[str]) -> int:
    """Run the node until the motion is over; the drives are damped when it ends."""
    options = parse(remove_ros_args(list(arguments)))
    motion = motion_of(options)
    rclpy.init(args=list(arguments), signal_handler_options=SignalHandlerOptions.NO)
    interrupt_on_signals()
    node, code = None, 0
    try:
        node = ExciteNode(options, motion)
        rclpy.spin_until_future_complete(node, node.done)
        code = int(node.done.result())
    except (KeyboardInterrupt, ExternalShutdownException):
        code = 130 if node is not None and node.active else 0
    finally:
        if node is not None:
            node.damp()
            node.destroy_node()
        rclpy.try_shutdown()
    return code
