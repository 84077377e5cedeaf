"""Topics that a node reads in batches, over real DDS."""

import time

import pytest
import rclpy
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from std_msgs.msg import String
from wattwalk_core.nodes.polled_topic import PolledTopic
from wattwalk_core.nodes.running import spin

PATIENCE = 60.0  # s


@pytest.fixture
def node(ros_domain):
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    made = rclpy.create_node('reader')
    yield made
    made.destroy_node()
    rclpy.try_shutdown()


@pytest.fixture
def writer(node):
    made = rclpy.create_node('writer')
    yield made
    made.destroy_node()


def qos(depth, reliability=ReliabilityPolicy.RELIABLE):
    return QoSProfile(depth=depth, reliability=reliability)


def connected(writer, depth=1000):
    publisher = writer.create_publisher(String, 'words', qos(depth))
    until(lambda: publisher.get_subscription_count() == 1)
    return publisher


def until(condition):
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.005)


def gather(take, count):
    """Messages taken until there are count of them."""
    taken = []
    until(lambda: taken.extend(take()) or len(taken) >= count)
    return taken


def test_a_burst_is_taken_whole_and_in_order_and_nothing_is_left(node, writer):
    topic = PolledTopic(node, String, 'words', qos(1000))
    assert list(topic.take()) == []
    publisher = connected(writer)
    for number in range(700):
        publisher.publish(String(data=str(number)))
    assert [m.data for m in gather(topic.take, 700)] == [str(n) for n in range(700)]
    assert list(topic.take()) == []
    assert topic.newest() is None


def test_the_depth_bounds_what_waits_and_the_newest_is_kept(node, writer):
    topic = PolledTopic(node, String, 'words', qos(1))
    publisher = connected(writer)
    for number in range(20):
        publisher.publish(String(data=str(number)))
    heard = []
    until(lambda: heard.append(topic.newest()) or (heard[-1] and heard[-1].data == '19'))


def test_raw_messages_are_the_cdr_bytes_with_the_time_of_their_publication(node, writer):
    topic = PolledTopic(node, String, 'words', qos(10), raw=True)
    publisher = connected(writer)
    before = time.time_ns()
    publisher.publish(String(data='watt'))
    ((cdr, published),) = gather(topic.take_with_source_time, 1)
    assert isinstance(cdr, bytes)
    assert deserialize_message(cdr, String).data == 'watt'
    assert before <= published <= time.time_ns()


def test_an_executor_serves_what_is_beside_a_topic_and_leaves_its_messages(node, writer):
    topic, heard = PolledTopic(node, String, 'words', qos(10)), []
    node.create_subscription(String, 'words', heard.append, 10)
    publisher = writer.create_publisher(String, 'words', qos(10))
    until(lambda: publisher.get_subscription_count() == 2)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    publisher.publish(String(data='watt'))
    until(lambda: executor.spin_once(timeout_sec=0.01) or heard)
    for _ in range(5):
        executor.spin_once(timeout_sec=0.01)
    executor.shutdown()
    assert [m.data for m in topic.take()] == ['watt']


def test_events_of_a_topic_are_served(node, writer):
    told = []
    events = SubscriptionEventCallbacks(incompatible_qos=told.append, use_default_callbacks=False)
    PolledTopic(node, String, 'words', qos(10), events=events)
    writer.create_publisher(String, 'words', qos(10, ReliabilityPolicy.BEST_EFFORT))
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    until(lambda: executor.spin_once(timeout_sec=0.01) or told)
    executor.shutdown()


def test_a_destroyed_topic_leaves_its_topic(node, writer):
    topic = PolledTopic(node, String, 'words', qos(10))
    publisher = connected(writer)
    topic.destroy()
    until(lambda: publisher.get_subscription_count() == 0)


class Polled(rclpy.node.Node):
    """Polls a topic, and ends with the third message or the third tick of a timer."""

    def __init__(self):
        super().__init__('polled')
        self.heard, self.ticks = [], 0
        self.all_heard, self.ticked = Future(), Future()
        self._words = PolledTopic(self, String, 'words', qos(10))
        self.create_timer(0.05, self.tick)

    def tick(self):
        self.ticks += 1
        if self.ticks == 3:
            self.ticked.set_result(None)

    def poll(self):
        self.heard += [m.data for m in self._words.take()]
        if len(self.heard) == 3 and not self.all_heard.done():
            self.all_heard.set_result(None)
        return 0.002


def test_a_node_that_polls_is_polled_and_its_timers_run_beside(node, writer):
    polled = Polled()
    publisher = connected(writer)
    spin(polled, polled.ticked)
    for word in ('volt', 'ampere', 'watt'):
        publisher.publish(String(data=word))
    spin(polled, polled.all_heard)
    assert polled.heard == ['volt', 'ampere', 'watt']
    polled.destroy_node()
