"""A node in the test's own process."""

import pytest
import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions


@pytest.fixture
def ros(ros_domain):
    """Start and stop rclpy in a domain of the test's own."""
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    yield
    rclpy.try_shutdown()


@pytest.fixture
def node(ros):
    """Give a node."""
    made = Node('bench')
    yield made
    made.destroy_node()


@pytest.fixture
def spin_until(node):
    """Spin until a condition holds; fail where it never does."""

    def spin(condition, patience=30.0):
        clock = rclpy.clock.Clock(clock_type=rclpy.clock.ClockType.STEADY_TIME)
        end = clock.now().nanoseconds + int(patience * 1e9)
        while not condition():
            assert clock.now().nanoseconds < end, 'the condition never held'
            rclpy.spin_once(node, timeout_sec=0.1)

    return spin
