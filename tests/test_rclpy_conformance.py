"""
Behaviour of rclpy that the nodes rely on.

The same tests run on ROS 2 and on the embedded runtime: what passes on both may be used in a node.
"""

import signal
import threading
from array import array
from contextlib import suppress

import numpy as np
import pytest
import rclpy
from contents import MESSAGES
from diagnostic_msgs.msg import DiagnosticStatus
from power_recordings.messages import cdr
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.clock_type import ClockType as ClockTypeOfItsModule
from rclpy.duration import Duration
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription
from rclpy.task import Future
from rclpy.timer import Timer
from rclpy.utilities import remove_ros_args
from sensor_msgs.msg import Imu, JointState
from std_srvs.srv import Trigger

from drive_power_msgs.msg import DriveSupply, PowerEstimate


@pytest.mark.parametrize('make', MESSAGES.values(), ids=list(MESSAGES))
def test_each_message_arrives_as_it_was_sent_and_raw_as_its_cdr(node, spin_until, make):
    sent, whole, raw = make(), [], []
    node.create_subscription(type(sent), 'topic', whole.append, 10)
    node.create_subscription(type(sent), 'topic', raw.append, 10, raw=True)
    publisher = node.create_publisher(type(sent), 'topic', 10)
    spin_until(lambda: publisher.get_subscription_count() == 2)
    publisher.publish(sent)
    spin_until(lambda: whole and raw)
    assert type(whole[0]) is type(sent)
    assert repr(whole[0]) == repr(sent)
    assert isinstance(raw[0], bytes)
    package = type(sent).__module__.split('.')[0]
    name = f'{package}/msg/{type(sent).__name__}'
    ours = cdr.serialize(name, cdr.deserialize(name, raw[0]))
    assert raw[0][:2] == ours[:2] == b'\0\1', 'little-endian CDR'
    assert raw[0][4 : len(ours)] == ours[4:]
    assert raw[0][len(ours) :] in (b'', b'\0', b'\0\0', b'\0\0\0'), 'padding to four bytes'
    assert repr(deserialize_message(serialize_message(sent), type(sent))) == repr(sent)


def test_publishers_of_a_topic_are_counted_by_its_relative_name(node, spin_until):
    assert node.count_publishers('topic') == 0
    node.create_publisher(PowerEstimate, 'topic', 10)
    spin_until(lambda: node.count_publishers('topic') == 1)
    assert node.count_publishers('/topic') == 1
    assert node.count_publishers('other') == 0


def test_a_nodes_publishers_wait_until_subscriptions_have_what_was_sent(node, spin_until):
    got = []
    node.create_subscription(PowerEstimate, 'topic', got.append, 10)
    publisher = node.create_publisher(PowerEstimate, 'topic', 10)
    spin_until(lambda: publisher.get_subscription_count())
    publisher.publish(MESSAGES['power_estimate']())
    assert publisher in list(node.publishers)
    assert publisher.wait_for_all_acked(Duration(seconds=5.0))
    spin_until(lambda: got)


def test_numbers_arrive_as_arrays_of_their_width(node, spin_until):
    got = []
    node.create_subscription(DriveSupply, 'topic', got.append, 10)
    publisher = node.create_publisher(DriveSupply, 'topic', 10)
    spin_until(lambda: publisher.get_subscription_count())
    publisher.publish(MESSAGES['drive_supply']())
    spin_until(lambda: got)
    message = got[0]
    codes = [x.typecode for x in (message.device_time, message.voltage, message.status)]
    assert codes == ['Q', 'f', 'B']
    assert isinstance(message.voltage, array)
    assert message.name == ['LF_HAA', 'LF_HFE']
    assert isinstance(Imu().orientation_covariance, np.ndarray)


def test_a_message_published_again_after_a_change_is_sent_anew(node, spin_until):
    got = []
    node.create_subscription(PowerEstimate, 'topic', got.append, 10)
    publisher = node.create_publisher(PowerEstimate, 'topic', 10)
    spin_until(lambda: publisher.get_subscription_count())
    message = PowerEstimate(power=[1.0])
    publisher.publish(message)
    message.power[0] = 2.0
    publisher.publish(message)
    spin_until(lambda: len(got) == 2)
    assert [list(x.power) for x in got] == [[1.0], [2.0]]


def test_the_level_of_a_diagnostic_status_is_one_byte():
    assert (DiagnosticStatus.OK, DiagnosticStatus.WARN) == (b'\x00', b'\x01')
    assert (DiagnosticStatus.ERROR, DiagnosticStatus.STALE) == (b'\x02', b'\x03')
    assert DiagnosticStatus().level == b'\x00'


def test_a_message_of_another_type_is_refused(node):
    publisher = node.create_publisher(JointState, 'topic', 10)
    with pytest.raises(TypeError):
        publisher.publish(Imu())


def test_a_late_joiner_gets_what_a_transient_local_publisher_sent(node, spin_until):
    qos = QoSProfile(
        depth=1,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
        history=HistoryPolicy.KEEP_LAST,
    )
    publisher = node.create_publisher(PowerEstimate, 'topic', qos)
    for total in (1.0, 2.0):
        publisher.publish(PowerEstimate(total=total))
    got = []
    node.create_subscription(PowerEstimate, 'topic', got.append, qos)
    spin_until(lambda: got)
    assert [message.total for message in got] == [2.0]


def test_unmatched_reliability_calls_the_event_and_the_subscription_can_be_replaced(
    node, spin_until
):
    best_effort = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    publisher = node.create_publisher(PowerEstimate, 'topic', best_effort)
    events, got = [], []
    callbacks = SubscriptionEventCallbacks(
        incompatible_qos=events.append, use_default_callbacks=False
    )
    reliable = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
    refused = node.create_subscription(
        PowerEstimate, 'topic', got.append, reliable, event_callbacks=callbacks
    )
    spin_until(lambda: events)
    assert events[0].total_count == 1
    assert node.destroy_subscription(refused)
    node.create_subscription(PowerEstimate, 'topic', got.append, best_effort)
    spin_until(lambda: publisher.get_subscription_count() == 1)
    spin_until(lambda: publisher.publish(PowerEstimate(total=3.0)) or got)
    assert got[0].total == 3.0


@pytest.mark.parametrize('kind', [ClockType.STEADY_TIME, ClockType.ROS_TIME])
def test_timers_run_on_the_clock_that_they_are_given(node, spin_until, kind):
    calls = []
    node.create_timer(0.01, lambda: calls.append(None), clock=Clock(clock_type=kind))
    spin_until(lambda: len(calls) == 3)


def test_a_timer_that_is_destroyed_calls_no_more(node, spin_until):
    calls, others = [], []
    timer = node.create_timer(0.01, lambda: calls.append(None))
    assert isinstance(timer, Timer)
    spin_until(lambda: calls)
    assert node.destroy_timer(timer)
    so_far = len(calls)
    node.create_timer(0.01, lambda: others.append(None))
    spin_until(lambda: len(others) == 5)
    assert len(calls) == so_far


def test_time_is_whole_nanoseconds_and_becomes_a_stamp(node):
    now = node.get_clock().now()
    stamp = now.to_msg()
    assert isinstance(now.nanoseconds, int)
    assert stamp.sec * 10**9 + stamp.nanosec == now.nanoseconds
    message = JointState()
    message.header.stamp = stamp
    assert message.header.stamp.sec == stamp.sec


@pytest.mark.parametrize('succeed', [True, False])
def test_a_service_answers_with_what_its_callback_returns(node, spin_until, succeed):
    def serve(request, response):
        assert isinstance(request, Trigger.Request)
        response.success, response.message = succeed, 'as you wish'
        return response

    node.create_service(Trigger, 'start', serve)
    client = node.create_client(Trigger, 'start')
    spin_until(client.service_is_ready)
    future = client.call_async(Trigger.Request())
    spin_until(future.done)
    assert (future.result().success, future.result().message) == (succeed, 'as you wish')


def test_names_are_resolved_and_remapped(ros_domain):
    rclpy.init(
        args=['--ros-args', '-r', '__ns:=/lab', '-r', 'imu:=base_imu'],
        signal_handler_options=SignalHandlerOptions.NO,
    )
    node = Node('conformance')
    try:
        assert node.get_name() == 'conformance'
        assert node.resolve_topic_name('joint_states') == '/lab/joint_states'
        assert node.resolve_topic_name('imu') == '/lab/base_imu'
        assert node.resolve_topic_name('/clock') == '/clock'
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def test_ros_arguments_are_taken_out_and_others_left():
    given = ['sim', '--seed', '3', '--ros-args', '-p', 'a:=1', '-r', 'x:=y', '--', '--pushes']
    assert remove_ros_args(given) == ['sim', '--seed', '3', '--pushes']
    assert remove_ros_args(['--ros-args', '-p', 'a:=1']) == []


def test_publishing_after_shutdown_raises_a_runtime_error(node):
    publisher = node.create_publisher(PowerEstimate, 'topic', 10)
    assert node.context.ok()
    assert rclpy.try_shutdown() is None
    assert not node.context.ok()
    with pytest.raises(RuntimeError):
        publisher.publish(PowerEstimate())
    rclpy.try_shutdown()


def test_spin_ends_when_a_callback_shuts_the_context_down(node):
    node.create_timer(0.01, node.context.try_shutdown)
    rclpy.spin(node)
    assert not node.context.ok()


def test_spin_ends_when_another_thread_shuts_the_context_down(node):
    end = threading.Timer(0.3, node.context.try_shutdown)
    end.start()
    with suppress(ExternalShutdownException):
        rclpy.spin(node)
    assert not node.context.ok()
    end.join()


def test_an_executor_ends_with_a_future_that_a_callback_completes(node):
    done = Future()
    node.create_timer(0.01, lambda: None if done.done() else done.set_result('enough'))
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    executor.spin_until_future_complete(done)
    assert done.result() == 'enough'
    executor.shutdown()


def test_a_task_of_another_thread_ends_a_turn_of_the_executor(node):
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    ran_in = []
    thread = threading.Timer(
        0.2, lambda: executor.create_task(lambda: ran_in.append(threading.current_thread()))
    )
    thread.start()
    while not ran_in:
        executor.spin_once()
    thread.join()
    assert ran_in == [threading.main_thread()]
    executor.shutdown()


def test_spinning_until_a_future_is_done_ends_with_it(node):
    done = Future()
    node.create_timer(0.01, lambda: None if done.done() else done.set_result('enough'))
    rclpy.spin_until_future_complete(node, done)
    assert done.result() == 'enough'


def test_clock_types_have_two_homes():
    assert ClockTypeOfItsModule is ClockType


def test_an_exception_of_a_callback_comes_out_of_spin(node):
    def fail():
        raise ValueError('from a callback')

    node.create_timer(0.01, fail)
    with pytest.raises(ValueError, match='from a callback'):
        rclpy.spin(node)


def test_handlers_of_signals_are_left_alone_where_asked(ros_domain):
    before = signal.getsignal(signal.SIGINT)
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    assert signal.getsignal(signal.SIGINT) is before
    rclpy.try_shutdown()


def test_throttled_messages_are_logged_once(node, capfd):
    for _ in range(3):
        node.get_logger().warning('behind', throttle_duration_sec=60.0)
    node.get_logger().info('other')
    out, err = capfd.readouterr()
    assert (out + err).count('behind') == 1


def test_one_place_in_the_code_logs_at_one_severity_only(node):
    def say(write):
        write('from one place')

    say(node.get_logger().info)
    say(node.get_logger().info)
    with pytest.raises(ValueError, match='severity cannot be changed'):
        say(node.get_logger().warning)


def test_qos_policies_tell_their_names():
    assert ReliabilityPolicy.BEST_EFFORT.name.lower() == 'best_effort'
    assert ReliabilityPolicy.RELIABLE.name.lower() == 'reliable'
    profile = QoSProfile(depth=5)
    assert (profile.depth, profile.history) == (5, HistoryPolicy.KEEP_LAST)
    assert profile.reliability == ReliabilityPolicy.RELIABLE
    assert profile.durability == DurabilityPolicy.VOLATILE


def test_a_subscription_may_belong_to_a_group_of_its_own(node, spin_until):
    got, group = [], MutuallyExclusiveCallbackGroup()
    node.create_subscription(JointState, 'topic', got.append, 10, callback_group=group)
    publisher = node.create_publisher(JointState, 'topic', 10)
    spin_until(lambda: publisher.get_subscription_count())
    publisher.publish(JointState())
    spin_until(lambda: got)


class Unserved(ReentrantCallbackGroup):
    def can_execute(self, entity):
        return not isinstance(entity, Subscription)


@pytest.mark.parametrize('raw', [False, True])
def test_a_group_keeps_a_subscription_from_the_executor_and_its_handle_gives_the_messages(
    node, spin_until, raw
):
    served, unserved = [], []
    subscription = node.create_subscription(
        JointState,
        'topic',
        unserved.append,
        10,
        callback_group=Unserved(),
        raw=raw,
    )
    node.create_subscription(JointState, 'topic', served.append, 10)
    publisher = node.create_publisher(JointState, 'topic', 10)
    spin_until(lambda: publisher.get_subscription_count() == 2)
    sent = JointState(name=['knee'], position=[0.5])
    publisher.publish(sent)
    spin_until(lambda: served)
    handle = subscription.handle
    with handle:
        message, info = handle.take_message(JointState, raw)
        assert handle.take_message(JointState, raw) is None
    assert message == (serialize_message(sent) if raw else sent)
    assert 0 < info['source_timestamp'] <= node.get_clock().now().nanoseconds
    assert unserved == []
