"""Inputs of a policy from topics."""

from collections.abc import Callable

from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Imu, JointState
from wattwalk_core.nodes.polled_topic import PolledTopic

from policy_runner.policies.inputs import Inputs

_SENSORS = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


class TopicInputs:
    """Reads the newest joint_states, imu, odom and cmd_vel into inputs; now: node's time, s."""

    def __init__(self, node: Node, inputs: Inputs, now: Callable[[], float]) -> None:
        self._inputs, self._now = inputs, now
        self._joints = PolledTopic[JointState](node, JointState, 'joint_states', _SENSORS)
        self._imu = PolledTopic[Imu](node, Imu, 'imu', _SENSORS)
        self._odom = PolledTopic[Odometry](node, Odometry, 'odom', _SENSORS)
        self._command = PolledTopic[TwistStamped](node, TwistStamped, 'cmd_vel', _SENSORS)

    def take(self) -> None:
        """Put the newest message of each topic into the inputs, as having arrived now."""
        for buffer, take in (
            (self._joints, self._on_joints),
            (self._imu, self._on_imu),
            (self._odom, self._on_odom),
            (self._command, self._on_command),
        ):
            message = buffer.newest()
            if message is not None:
                take(message)

    def _on_joints(self, message: JointState) -> None:
        m = message
        self._inputs.on_joints(_ns(m), m.name, m.position, m.velocity, self._now())

    def _on_imu(self, message: Imu) -> None:
        q, w, a = message.orientation, message.angular_velocity, message.linear_acceleration
        self._inputs.on_imu(
            _ns(message), (q.x, q.y, q.z, q.w), (w.x, w.y, w.z), self._now(), (a.x, a.y, a.z)
        )

    def _on_odom(self, message: Odometry) -> None:
        v = message.twist.twist.linear
        self._inputs.on_odom(_ns(message), (v.x, v.y, v.z), self._now())

    def _on_command(self, message: TwistStamped) -> None:
        twist = message.twist
        self._inputs.on_command((twist.linear.x, twist.linear.y, twist.angular.z), self._now())


def _ns(message: JointState | Imu | Odometry) -> int:
    stamp = message.header.stamp
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)
