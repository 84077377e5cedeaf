"""Node that runs a policy on the robot: joint states and IMU in, joint commands out."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Final

from geometry_msgs.msg import TwistStamped
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from wattwalk_core.anymal import JOINT_NAMES
from wattwalk_core.errors import InputError
from wattwalk_core.nodes.diagnostics import Level, Report, Reporter
from wattwalk_core.nodes.parameters import DeviceParameters
from wattwalk_core.nodes.running import run_node
from wattwalk_core.nodes.services import offer

from policy_runner.nodes.run_options import Options
from policy_runner.nodes.topic_inputs import TopicInputs
from policy_runner.policies.by_name import Policy, load_policy
from policy_runner.supervisor.safety import FaultKind, SafetyConfig
from policy_runner.supervisor.supervisor import LoopTiming, State, Supervisor, SupervisorOutput

_LOOK: Final = 0.005  # s between looks at the inputs: the resolution of their age
_COMMANDS = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)


class PolicyRunner(Node):
    """Runs a policy at a fixed rate under a supervisor; InputError for bad parameters."""

    def __init__(self, options: Options) -> None:
        super().__init__('policy_runner')
        text = 'name of the policy that runs, or its folder; may be set at any time'
        descriptor = ParameterDescriptor(description=text)
        self._policy = str(self.declare_parameter('policy', options.policy, descriptor).value)
        given = DeviceParameters(self)
        options = options.declared(given)
        self._trust_code = options.trust_code
        policy = load_policy(self._policy, trust_code=self._trust_code)
        asked = given.real('rate', policy.rate, 'Hz at which it is asked', 10.0, 400.0)
        self._rate = None if asked == policy.rate else asked
        safety = SafetyConfig()
        stale = given.real(
            'stale_after', safety.stale_after, 's; older joint_states or imu: damping', 0.01, 1.0
        )
        tilt = given.real('tilt', safety.tilt, 'rad; more from level: damping', 0.1, 1.5)
        self._start_wanted = options.start
        source = options.source()
        self._supervisor = Supervisor(
            policy,
            SafetyConfig(stale_after=stale, tilt=tilt),
            restart_after=options.restart_after,
            source=source,
        )
        simulated = bool(self.get_parameter('use_sim_time').value)
        self._time = self.get_clock() if simulated else Clock(clock_type=ClockType.STEADY_TIME)
        self._told: tuple[State, str] | None = None
        self._inputs = TopicInputs(self, self._supervisor.inputs, self._now)
        self._commands = self.create_publisher(JointState, 'joint_commands', _COMMANDS)
        self._reporter = Reporter(self)
        if source is not None:
            self._told_velocity = self.create_publisher(TwistStamped, 'cmd_vel', _COMMANDS)
            self.create_timer(0.1, self._tell_velocity, clock=self._time)
        offer(self, 'start', partial(self._serve, self._supervisor.start))
        offer(self, 'stop', partial(self._serve, self._supervisor.stop))
        offer(self, 'estop', partial(self._serve, self._supervisor.emergency_stop))
        self.period = self._period_of(policy)
        self._timing = LoopTiming(self.period)
        self._due = self._now() + self.period
        self.add_on_set_parameters_callback(self._on_parameters)
        self.create_timer(1.0, self._diagnose, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _period_of(self, policy: Policy) -> float:
        return 1.0 / (self._rate or policy.rate)

    def poll(self) -> float:
        """Take what has come and run the step that is due; return the s until the next look."""
        self._inputs.take()
        now = self._now()
        if now == 0.0:
            return _LOOK  # ROS time that has not begun
        if self._due - now > 2.0 * self.period:
            self._due = now  # ROS time was set back
        if now >= self._due:
            self._due += self.period * (1 + (now - self._due) // self.period)
            self._step()
        return min(_LOOK, self._due - self._now())

    def _on_parameters(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        for parameter in parameters:
            if parameter.name != 'policy':
                continue
            try:
                policy = load_policy(str(parameter.value), trust_code=self._trust_code)
            except InputError as error:
                return SetParametersResult(successful=False, reason=str(error))
            done, message = self._supervisor.change(policy, self._now())
            if not done:
                return SetParametersResult(successful=False, reason=message)
            self._policy = str(parameter.value)
            self.get_logger().info(f'{self._policy}: {message}')
            self.period = self._period_of(policy)
            self._timing.change(self.period)
            self._due = self._now() + self.period
        return SetParametersResult(successful=True)

    def stop(self) -> None:
        """Send a last damping command, unless none was sent before."""
        if self._supervisor.state is not State.IDLE:
            self._send(SupervisorOutput(None))

    def _now(self) -> float:
        return float(self._time.now().nanoseconds) * 1e-9

    def _serve(self, action: Callable[[float], tuple[bool, str]]) -> tuple[bool, str]:
        self._start_wanted = False
        answer = action(self._now())
        self._announce()
        return answer

    def _step(self) -> None:
        now = self._now()
        self._timing.begin(now)
        if self._start_wanted:
            started, why = self._supervisor.start(now)
            self._start_wanted = not started
            if not started:
                self.get_logger().info(f'waiting: {why}', throttle_duration_sec=5.0)
        output = self._supervisor.update(now)
        if output is not None:
            self._send(output)
            self._timing.end(self._now())
        self._announce()

    def _send(self, output: SupervisorOutput) -> None:
        message = JointState()
        message.header.stamp = self.get_clock().now().to_msg()
        message.name = list(JOINT_NAMES)
        if output.targets is None:
            message.velocity = [0.0] * len(JOINT_NAMES)
        else:
            message.position = output.targets.tolist()
        self._commands.publish(message)

    def _tell_velocity(self) -> None:
        """Publish the velocity command in force, for recordings."""
        message = TwistStamped()
        message.header.stamp = self.get_clock().now().to_msg()
        vx, vy, yaw = self._supervisor.command(self._now()).tolist()
        message.twist.linear.x, message.twist.linear.y = vx, vy
        message.twist.angular.z = yaw
        self._told_velocity.publish(message)

    @property
    def _sound(self) -> bool:
        fault = self._supervisor.fault
        return fault is None or fault.kind is FaultKind.STOP

    def _announce(self) -> None:
        state, reason = self._supervisor.state, self._supervisor.reason
        if (state, reason) == self._told:
            return
        self._told = (state, reason)
        if self._sound:
            waits = state is State.IDLE and not self._start_wanted
            told = f'{reason}; its service start makes the robot stand up' if waits else reason
            self.get_logger().info(f'{self._policy}: {told}')
        else:
            self.get_logger().error(f'{self._policy}: damping, {reason}')
        self._diagnose()

    def _diagnose(self) -> None:
        figures = self._supervisor.figures(self._now()) | self._timing.figures()
        level = Level.OK if self._sound else Level.ERROR
        reason = self._supervisor.reason
        self._reporter.publish(Report(level, reason, {'policy': self._policy, **figures}))


def run(given: tuple[Options, Sequence[str]]) -> int:
    """Run the node until it is interrupted; the drives are damped when it ends."""
    options, arguments = given
    return run_node(lambda: PolicyRunner(options), arguments)
