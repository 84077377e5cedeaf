"""Node that executes a motion: joint states in, joint commands out."""

from collections.abc import Callable, Sequence

from diagnostic_msgs.msg import DiagnosticArray
from policy_runner.policies.inputs import Inputs
from policy_runner.supervisor.safety import SafetyConfig
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from sensor_msgs.msg import JointState
from wattwalk_core.errors import InputError
from wattwalk_core.nodes.diagnostics import Level, Report, Reporter
from wattwalk_core.nodes.parameters import DeviceParameters
from wattwalk_core.nodes.running import run_node
from wattwalk_core.nodes.services import offer

from drive_bench.motion.file import MotionFile
from drive_bench.motion.joint_limits import limits_of
from drive_bench.run.motion_policy import MotionPolicy
from drive_bench.run.motion_run import Command, MotionRun, present
from drive_bench.run.options import RunOptions, resolve
from drive_bench.run.recording import MotionRecording
from drive_power_msgs.msg import DriveSupply

_SENSORS = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
_COMMANDS = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
_AFTERWARDS = 1.0  # s of damping before the node ends
_Action = Callable[[MotionRun, float], tuple[bool, str]]


class MotionNode(Node):
    """Node of one motion, recorded if the options say so.

    done: a future of the exit code. InputError for invalid options or ROS parameters.
    """

    def __init__(self, options: RunOptions, motion: MotionFile) -> None:
        super().__init__('drive_bench')
        self._options, self._motion = options, motion
        self._drives = tuple(dict.fromkeys(options.drive or motion.drives[:1]))
        if not self._drives:
            raise InputError(f'{options.motion} names no drive; give --drive NAME')
        limits_of(self._drives, options.limits)
        given = DeviceParameters(self)
        rate = given.real('rate', MotionPolicy.rate, 'Hz of joint_commands', 50.0, 400.0)
        stale = given.real('stale_after', 0.06, 's; older joint_states: damping', 0.01, 1.0)
        self._config = SafetyConfig(stale_after=stale)
        self._start_requested = options.start
        self._run: MotionRun | None = None
        self._ended: float | None = None
        self._announced, self._noted = '', 0
        self.done: Future = Future()
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._time = self.get_clock() if self.get_parameter('use_sim_time').value else steady
        self._commands = self.create_publisher(JointState, 'joint_commands', _COMMANDS)
        self._reporter = Reporter(self)
        self.create_subscription(JointState, 'joint_states', self._on_joints, _SENSORS)
        if motion.warms:
            self.create_subscription(DriveSupply, 'drive_supply', self._on_supply, _SENSORS)
        self._recording: MotionRecording | None = None
        if options.record is None:
            self._offer('start', MotionRun.start)
        else:
            space = self.get_namespace()
            place = () if space == '/' else ('-r', f'__ns:={space}')
            self._recording = MotionRecording(options, place)
            listen = self._recording.on_diagnostics
            self.create_subscription(DiagnosticArray, 'diagnostics', listen, 10)
            self.create_timer(0.1, self._advance_recording, clock=steady)
        self._offer('stop', MotionRun.stop)
        self._offer('estop', MotionRun.emergency_stop)
        self.create_timer(1.0 / rate, self._step, clock=self._time)
        self.create_timer(1.0, self._check, clock=steady)

    def stop(self) -> int | None:
        """Damp moving drives and complete the recording; return the exit code, None if unknown."""
        code: int | None = self.done.result() if self.done.done() else None
        if self._run is not None and self._run.active:
            self._run.stop(self._now())
            self._send(self._run.damping)
            self._announce(self._run)
            code = 130
        if self._recording is None:
            return code
        return max(130 if code is None else code, self._recording.finish(self._run))

    def _offer(self, name: str, action: _Action) -> None:
        def serve() -> tuple[bool, str]:
            if self._run is None:
                self._start_requested = self._start_requested and name == 'start'
                return False, 'joint_states never came'
            self._start_requested = False
            self._run.count_publishers(self.count_publishers('joint_commands'))
            return action(self._run, self._now())

        offer(self, name, serve)

    def _now(self) -> float:
        return float(self._time.now().nanoseconds) * 1e-9

    def _on_joints(self, message: JointState) -> None:
        if self._run is None:
            self._run = self._run_of(message)
            self._run.count_publishers(self.count_publishers('joint_commands'))
            self.get_logger().info(self._run.introduction(bool(self._recording)))
        _take(self._run.inputs, message, self._now())

    def _run_of(self, message: JointState) -> MotionRun:
        names, options = tuple(message.name), self._options
        read = Inputs(names)
        _take(read, message, 0.0)
        return MotionRun(
            self._motion,
            names,
            resolve(self._drives, names, present(read)),
            options.mounting,
            limits_of(names, options.limits),
            self._config,
            damp_others=options.damp_others,
            fit=options.fit,
        )

    def _on_supply(self, message: DriveSupply) -> None:
        if self._run is not None:
            windings = self._run.policy.windings
            windings.on_supply(message.name, message.temperature, self._now())

    def _advance_recording(self) -> None:
        assert self._recording is not None
        supplied = self.count_publishers('drive_supply') > 0
        self._wait_for(self._recording.advance(self._run, self._now(), supplied))

    def _wait_for(self, missing: str) -> None:
        if missing:
            self.get_logger().info(f'waiting: {missing}', throttle_duration_sec=5.0)

    def _step(self) -> None:
        run, now = self._run, self._now()
        if run is None:
            return
        if self._start_requested and run.start(now)[0]:
            self._start_requested = False
        command = run.update(now)
        if command is not None:
            self._send(command)
        self._announce(run)
        if run.code is not None:
            self._ended = now if self._ended is None else self._ended
            if now - self._ended >= _AFTERWARDS and not self.done.done():
                self.done.set_result(run.code)

    def _send(self, command: Command) -> None:
        message = JointState(name=list(command.names))
        message.header.stamp = self.get_clock().now().to_msg()
        for field in ('position', 'velocity', 'effort'):
            values = getattr(command, field)
            if values is not None:
                setattr(message, field, list(values))
        self._commands.publish(message)

    def _announce(self, run: MotionRun) -> None:
        for note in run.notes[self._noted :]:
            self.get_logger().warning(f'fitted: {note}')
        self._noted = len(run.notes)
        if run.reason == self._announced:
            return
        self._announced = run.reason
        if run.code == 1:
            self.get_logger().error(f'damping, {run.reason}')
        else:
            self.get_logger().info(run.progress(bool(self._recording)))
        self._report(run)

    def _check(self) -> None:
        if self._run is None:
            self.get_logger().info('waiting for joint_states', throttle_duration_sec=10.0)
            return
        self._run.count_publishers(self.count_publishers('joint_commands'))
        if self._start_requested:
            self._wait_for(self._run.unsound(self._now()))
        self._report(self._run)

    def _report(self, run: MotionRun) -> None:
        why = '' if run.active or run.code is not None else run.unsound(self._now())
        level = Level.ERROR if run.code == 1 else Level.WARN if why else Level.OK
        sentence = f'not ready: {why}' if why else run.reason
        self._reporter.publish(Report(level, sentence, run.figures(self._now())))


def _take(inputs: Inputs, message: JointState, now: float) -> None:
    m, stamp = message, message.header.stamp
    nanoseconds = int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)
    inputs.on_joints(nanoseconds, m.name, m.position, m.velocity, now, m.effort)


def run(given: tuple[RunOptions, MotionFile, Sequence[str]]) -> int:
    """Run the node until the motion is over; return the exit code."""
    options, motion, arguments = given
    return run_node(lambda: MotionNode(options, motion), arguments)
