import os
import signal
import threading

import pytest
import rclpy
from power_daq.spinning import spin
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from std_msgs.msg import String


@pytest.fixture
def node(ros_domain):
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    made = rclpy.create_node('spinning')
    yield made
    made.destroy_node()
    rclpy.try_shutdown()


def test_a_callback_that_publishes_while_the_context_is_shut_down_is_no_error(node):
    publisher = node.create_publisher(String, 'word', 10)

    def publish_too_late():
        node.context.try_shutdown()
        publisher.publish(String(data='too late'))

    node.create_timer(0.01, publish_too_late)
    spin(node)
    assert not node.context.ok()


def test_a_runtime_error_of_a_callback_is_raised(node):
    def fail():
        raise RuntimeError('the device is gone')

    node.create_timer(0.01, fail)
    with pytest.raises(RuntimeError, match='the device is gone'):
        spin(node)


def test_ctrl_c_ends_it_without_an_exception(node):
    node.create_timer(0.1, lambda: None)
    end = threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT))
    end.start()
    spin(node)
    end.join()
    assert node.context.ok()


def test_it_ends_with_the_future_it_is_given(node):
    done = Future()
    node.create_timer(0.01, lambda: None if done.done() else done.set_result(None))
    spin(node, done)
    assert node.context.ok()
