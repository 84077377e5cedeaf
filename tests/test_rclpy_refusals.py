"""Mistakes of a node's developer that rclpy refuses or warns of, on both runtimes alike."""

import pytest
from builtin_interfaces.msg import Duration as DurationMessage
from rclpy.clock import Clock
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.logging import get_logger
from rclpy.qos import HistoryPolicy, InvalidQoSProfileException, QoSProfile
from rclpy.time import Time
from sensor_msgs.msg import JointState


@pytest.mark.parametrize(
    ('make', 'error'),
    [
        (lambda node: QoSProfile(), InvalidQoSProfileException),
        (lambda node: QoSProfile(history=HistoryPolicy.KEEP_LAST), InvalidQoSProfileException),
        (lambda node: QoSProfile(depth=1, speed=2), AssertionError),
        (lambda node: QoSProfile(depth='1'), AssertionError),
        (lambda node: QoSProfile(depth=1, reliability='reliable'), AssertionError),
        (lambda node: QoSProfile(depth=1, reliability=77), ValueError),
        (
            lambda node: node.create_publisher(JointState, 'topic', QoSProfile(depth=-1)),
            RuntimeError,
        ),
        (lambda node: node.create_publisher(JointState, 'topic', 10, speed=2), TypeError),
        (lambda node: node.create_publisher(JointState, 3, 10), TypeError),
        (lambda node: node.create_timer(-1.0, print), (ValueError, RuntimeError)),
        (lambda node: Context().init(args=[], domain_id=-1), RuntimeError),
        (lambda node: Clock(clock_type=1), TypeError),
        (lambda node: node.get_clock().set_ros_time_override(3), TypeError),
        (lambda node: Time.from_msg(DurationMessage()), TypeError),
        (lambda node: Time(nanoseconds=1) - Duration(nanoseconds=2), ValueError),
        (lambda node: get_logger(''), ValueError),
    ],
)
def test_what_cannot_be_meant_is_refused(node, make, error):
    with pytest.raises(error):
        make(node)


def test_a_depth_of_zero_is_warned_of():
    with pytest.warns(UserWarning, match="A zero depth with KEEP_LAST doesn't make sense"):
        QoSProfile(depth=0)
