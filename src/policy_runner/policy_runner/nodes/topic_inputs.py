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
        inputs = self._inputs
        if (joints := self._joints.newest()) is not None:
            read = joints.name, joints.position, joints.velocity
            inputs.on_joints(_ns(joints), *read, self._now())
        if (imu := self._imu.newest()) is not None:
            q, w, a = imu.orientation, imu.angular_velocity, imu.linear_acceleration
            turned, felt = (q.x, q.y, q.z, q.w), (a.x, a.y, a.z)
            inputs.on_imu(_ns(imu), turned, (w.x, w.y, w.z), self._now(), felt)
        if (odom := self._odom.newest()) is not None:
            v = odom.twist.twist.linear
            inputs.on_odom(_ns(odom), (v.x, v.y, v.z), self._now())
        if (command := self._command.newest()) is not None:
            linear, turning = command.twist.linear, command.twist.angular
            inputs.on_command((linear.x, linear.y, turning.z), self._now())


def _ns(message: JointState | Imu | Odometry) -> int:
    stamp = message.header.stamp
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)
