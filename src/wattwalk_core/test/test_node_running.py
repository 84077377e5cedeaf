import re
import signal
import time

import pytest
import rclpy
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from std_msgs.msg import String
from wattwalk_core.nodes.running import PATIENCE, run_node, spin

NODE = """
import sys
import threading
import time

import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.task import Future
from std_msgs.msg import String
from wattwalk_core.nodes.running import run_node


class Busy(Node):
    def __init__(self):
        super().__init__('busy')
        {making}
        self.words = self.create_publisher(String, 'word', QoSProfile(depth=10))
        self.create_subscription(String, 'word', self.hear, QoSProfile(depth=10))
        self.create_timer(0.001, self.work)
        self.heard = 0
        print('made', flush=True)

    def hear(self, message):
        self.heard += 1
        if self.heard == 20:
            print('spinning', flush=True)

    def work(self):
        self.words.publish(String(data='at work'))
        {work}

    def stop(self):
        print('stopping', flush=True)
        {stop}
        self.words.publish(String(data='the last word'))
        print('stopped, context ok:', rclpy.ok(), flush=True)


code = run_node(Busy, sys.argv)
print('ended', flush=True)
sys.exit(code)
"""


@pytest.fixture
def busy(node_process, tmp_path):
    """Starts a node that publishes to itself at 1 kHz, with lines of code put in."""

    def start(making='', work='', stop=''):
        script = tmp_path / 'busy.py'
        script.write_text(NODE.format(making=making, work=work, stop=stop))
        return node_process.python(script)

    return start


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


def test_it_ends_with_the_first_of_the_futures_it_is_given(node):
    never, done = Future(), Future()
    node.create_timer(0.01, lambda: None if done.done() else done.set_result(None))
    spin(node, never, done)
    assert node.context.ok()
    assert not never.done()
    spin(node, done)


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_node_in_good_order_with_its_context_valid(busy, number):
    process = busy()
    process.wait_for_output('spinning')
    process.send_signal(number)
    assert process.wait() == 0
    assert process.lines[-3:] == ['stopping', 'stopped, context ok: True', 'ended']


def test_a_last_message_published_while_stopping_is_heard(busy, node):
    heard = []
    over = Future()

    def hear(message):
        heard.append(message.data)
        if message.data == 'the last word' and not over.done():
            over.set_result(None)

    node.create_subscription(String, 'word', hear, 10)
    process = busy(stop='time.sleep(0.2)')
    process.wait_for_output('spinning')
    beginning = Future()
    node.create_timer(
        0.05, lambda: beginning.set_result(None) if heard and not beginning.done() else None
    )
    spin(node, beginning)
    process.interrupt()
    limit = Future()
    node.create_timer(20.0, lambda: None if limit.done() else limit.set_result(None))
    spin(node, over, limit)
    assert heard[-1] == 'the last word'
    assert process.wait() == 0


def test_a_signal_while_a_node_is_made_ends_it_before_it_spins_for_long(busy):
    process = busy(making="print('making', flush=True); time.sleep(1.0)")
    process.wait_for_output('making')
    process.interrupt()
    assert process.wait() == 0
    assert process.lines[1:] == ['made', 'stopping', 'stopped, context ok: True', 'ended']


def test_further_signals_do_not_cut_the_end_off(busy):
    process = busy(stop="time.sleep(1.0); print('slept', flush=True)")
    process.wait_for_output('spinning')
    process.interrupt()
    process.wait_for_output('stopping')
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGINT):
        process.send_signal(number)
        time.sleep(0.1)
    assert process.wait() == 0
    assert process.lines[-3:] == ['slept', 'stopped, context ok: True', 'ended']


@pytest.mark.parametrize('where', ['making', 'work'])
def test_what_hangs_is_left_after_the_patience_and_not_before(busy, where):
    hang = "print('hanging', flush=True); time.sleep(600.0)"
    process = busy(**{where: hang})
    process.wait_for_output('hanging')
    began = time.monotonic()
    process.interrupt()
    assert process.wait() == 0
    assert PATIENCE <= time.monotonic() - began < PATIENCE + 10.0
    assert ('stopped, context ok: True' in process.lines) == (where == 'work')
    assert process.lines[-1] == 'ended'


def test_an_error_of_a_callback_comes_out_after_the_node_was_stopped(busy):
    process = busy(work="raise OSError('the device is gone')")
    assert process.wait() == 1
    assert 'stopped, context ok: True' in process.lines
    assert process.lines[-1] == 'OSError: the device is gone'


@pytest.mark.parametrize(
    ('result', 'stop', 'code'), [(None, None, 0), (3, None, 3), (3, 130, 130), (3, 0, 0)]
)
def test_the_exit_code_is_that_of_done_unless_stop_returns_one(ros_domain, result, stop, code):
    def make():
        node = rclpy.create_node('counting')
        node.done = Future()
        node.stop = lambda: stop
        node.create_timer(0.01, lambda: node.done.done() or node.done.set_result(result))
        return node

    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    assert run_node(make, []) == code
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == before
    assert not rclpy.ok()


def test_an_error_while_a_node_is_made_leaves_no_context_and_no_handler(ros_domain):
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(ZeroDivisionError):
        run_node(lambda: 1 / 0, [])
    assert signal.getsignal(signal.SIGINT) is before
    assert not rclpy.ok()


def test_a_node_at_1_khz_ends_in_good_order_at_any_moment(node_process, tmp_path):
    script = tmp_path / 'again.py'
    script.write_text(
        NODE.partition('code = run_node')[0].format(making='', work='', stop='')
        + 'import os, random, signal\n'
        'for turn in range(40):\n'
        "    number = random.Random(turn).choice(['INT', 'TERM'])\n"
        '    kill = lambda: os.kill(os.getpid(), signal.Signals[f"SIG{number}"])\n'
        '    timer = threading.Timer(random.Random(turn).uniform(0.0, 0.2), kill)\n'
        '    def make():\n'
        '        timer.start()\n'
        '        return Busy()\n'
        '    assert run_node(make, sys.argv) == 0\n'
        '    timer.join()\n'
        '    print("turn", turn, flush=True)\n'
    )
    process = node_process.python(script)
    assert process.wait(120.0) == 0, process.output
    assert len(re.findall('stopped, context ok: True', process.output)) == 40
    assert 'Traceback' not in process.output
