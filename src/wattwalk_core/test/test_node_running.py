import signal

import pytest
import rclpy
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from std_msgs.msg import String
from wattwalk_core.nodes.running import spin


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


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_signals_end_it_without_an_exception(node_process, tmp_path, number):
    script = tmp_path / 'node.py'
    script.write_text(
        'import rclpy\nfrom wattwalk_core.nodes.running import spin\n'
        'rclpy.init()\nnode = rclpy.create_node("spinning")\n'
        'node.create_timer(0.1, lambda: print("spinning"))\n'
        'spin(node)\nprint("ended", flush=True)\n'
        'node.destroy_node()\nrclpy.try_shutdown()\n'
    )
    process = node_process.python(script)
    process.wait_for_output('spinning')
    process.send_signal(number)
    process.wait_for_output('ended')
    assert process.wait() == 0


def test_it_ends_with_the_future_it_is_given(node):
    done = Future()
    node.create_timer(0.01, lambda: None if done.done() else done.set_result(None))
    spin(node, done)
    assert node.context.ok()
