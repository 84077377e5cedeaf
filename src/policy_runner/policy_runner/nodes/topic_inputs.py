"""Inputs of a policy from topics."""

from collections.abc import Callable

from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Imu, JointState

from policy_runner.policies.inputs import Inputs

_SENSORS = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


class Listener:
    """Subscriptions to joint_states, imu, odom and cmd_vel; now gives the node's time in s."""

    def __init__(self, node: Node, inputs: Inputs, now: Callable[[], float]) -> None:
        self._inputs, self._now = inputs, now
        node.create_subscription(JointState, 'joint_states', self._on_joints, _SENSORS)
        node.create_subscription(Imu, 'imu', self._on_imu, _SENSORS)
        node.create_subscription(Odometry, 'odom', self._on_odom, _SENSORS)
        node.create_subscription(TwistStamped, 'cmd_vel', self._on_command, _SENSORS)

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
