"""Fixtures of tests across nodes."""

import pytest
import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from supply_bench import Bench

PATIENCE = 30.0


@pytest.fixture
def bench():
    """A supply's poller and the simulated instrument that it asks."""
    bench = Bench()
    yield bench
    bench.close()


@pytest.fixture
def ros(ros_domain):
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    yield
    rclpy.try_shutdown()


@pytest.fixture
def node(ros):
    made = Node('conformance')
    yield made
    made.destroy_node()


@pytest.fixture
def spin_until(node):
    def spin(condition):
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        end = clock.now().nanoseconds + int(PATIENCE * 1e9)
        while not condition():
            assert clock.now().nanoseconds < end, 'the condition never held'
            rclpy.spin_once(node, timeout_sec=0.1)

    return spin
