"""Nodes within one process: names, endpoints, services, life and death."""

import signal
import threading
from contextlib import nullcontext, suppress

import pytest
import rclpy
from rclpy._rclpy_pybind11 import InvalidHandle, RCLError
from rclpy.exceptions import (
    InvalidNamespaceException,
    InvalidNodeNameException,
    InvalidServiceNameException,
    InvalidTopicNameException,
    NotInitializedException,
)
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Int32, String
from std_srvs.srv import SetBool, Trigger


@pytest.mark.parametrize('name', ['', '7up', 'a b', 'a/b', 'ä'])
def test_invalid_node_names_raise(ros, name):
    with pytest.raises(InvalidNodeNameException):
        Node(name)


@pytest.mark.parametrize('namespace', ['/a//b', '/7', '/a-b', '/a/'])
def test_invalid_namespaces_raise(ros, namespace):
    with pytest.raises(InvalidNamespaceException):
        Node('fine', namespace=namespace)


@pytest.mark.parametrize('name', ['', 'a b', '7a', 'a/', '/a//b', 'a~', '~ab', '{node', 'a-b'])
def test_invalid_topic_and_service_names_raise(node, name):
    with pytest.raises(InvalidTopicNameException):
        node.create_publisher(String, name, 10)
    with pytest.raises(InvalidServiceNameException):
        node.create_client(Trigger, name)


@pytest.mark.parametrize(
    ('name', 'expected'),
    [
        ('a', '/lab/a'),
        ('/a', '/a'),
        ('~/a', '/lab/tool/a'),
        ('b/c', '/lab/b/c'),
        ('{node}/a', '/lab/tool/a'),
        ('from', '/to'),
        ('~/private', '/lab/public'),
    ],
)
def test_names_are_resolved_and_remapped(ros, name, expected):
    remaps = ['--ros-args', '-r', 'from:=/to', '-r', '~/private:=public', '-r', 'someone:a:=z']
    node = Node('tool', namespace='lab', cli_args=remaps)
    assert node.get_fully_qualified_name() == '/lab/tool'
    assert node.resolve_topic_name(name) == expected
    assert node.create_publisher(String, name, 10).topic_name == expected
    node.destroy_node()


def test_messages_come_decoded_raw_and_with_their_times(node, spin_until):
    publisher = node.create_publisher(Int32, 'number', 10)
    decoded, raw, informed = [], [], []
    node.create_subscription(Int32, 'number', decoded.append, 10)
    node.create_subscription(Int32, 'number', raw.append, 10, raw=True)
    node.create_subscription(Int32, 'number', lambda m, info: informed.append(info), 10)
    publisher.publish(Int32(data=5))
    publisher.publish(serialize_message(Int32(data=6)))
    spin_until(lambda: len(decoded) == len(raw) == len(informed) == 2)
    assert [message.data for message in decoded] == [5, 6]
    assert type(raw[0]) is bytes
    assert deserialize_message(raw[1], Int32).data == 6
    assert 0 < informed[0]['source_timestamp'] <= informed[1]['source_timestamp']


def test_a_depth_of_one_keeps_the_newest(node, spin_until):
    publisher = node.create_publisher(Int32, 'number', 10)
    got = []
    node.create_subscription(Int32, 'number', lambda m: got.append(m.data), 1)
    for number in range(5):
        publisher.publish(Int32(data=number))
    spin_until(lambda: got)
    assert got == [4]


def test_messages_of_another_type_are_not_published(node):
    publisher = node.create_publisher(String, 'a', 10)
    with pytest.raises(TypeError, match='Expected'):
        publisher.publish(Int32(data=1))
    with pytest.raises(TypeError):
        publisher.publish(String(data=1))


def test_a_callback_of_no_or_three_arguments_is_refused(node):
    for callback in (lambda: None, lambda a, b, c: None):
        with pytest.raises(RuntimeError, match='callback'):
            node.create_subscription(String, 'a', callback, 10)


@pytest.mark.parametrize('qos', ['10', None, 1.5])
def test_a_qos_that_is_none_is_refused(node, qos):
    with pytest.raises(TypeError):
        node.create_publisher(String, 'a', qos)


def test_negative_depth_is_refused(node):
    with pytest.raises(ValueError, match='depth'):
        node.create_publisher(String, 'a', -1)


def test_endpoints_are_counted_and_listed(node, spin_until):
    publisher = node.create_publisher(String, 'a', 10)
    subscription = node.create_subscription(String, 'a', lambda m: None, QoSProfile(depth=1))
    spin_until(lambda: publisher.get_subscription_count() == 1)
    spin_until(lambda: node.count_publishers('a') == node.count_subscribers('a') == 1)
    assert ('/a', ['std_msgs/msg/String']) in node.get_topic_names_and_types()
    assert node.destroy_subscription(subscription)
    assert not node.destroy_subscription(subscription)
    spin_until(lambda: publisher.get_subscription_count() == 0)


def test_services_answer_each_client_its_own(node, spin_until):
    def answer(request, response):
        response.success = request.data
        return response

    node.create_service(SetBool, 'switch', answer)
    clients = [node.create_client(SetBool, 'switch') for _ in range(2)]
    assert all(client.wait_for_service(timeout_sec=10.0) for client in clients)
    futures = [
        client.call_async(SetBool.Request(data=value))
        for client, value in zip(clients, (True, False), strict=True)
    ]
    spin_until(lambda: all(future.done() for future in futures))
    assert [future.result().success for future in futures] == [True, False]


def test_a_blocking_call_is_answered_while_another_thread_spins(node):
    node.create_service(Trigger, 'go', lambda _, response: response)
    client = node.create_client(Trigger, 'go')
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    spinner = threading.Thread(target=executor.spin, daemon=True)
    spinner.start()
    assert client.wait_for_service(timeout_sec=10.0)
    assert client.call(Trigger.Request(), timeout_sec=10.0) == Trigger.Response()
    executor.shutdown()
    spinner.join(10.0)
    assert not spinner.is_alive()


def test_a_service_that_is_not_there_is_waited_for_in_vain(node):
    client = node.create_client(Trigger, 'nobody')
    assert not client.service_is_ready()
    assert not client.wait_for_service(timeout_sec=0.0)


def test_spinning_until_a_future_is_done_returns_at_the_timeout(node):
    future = rclpy.Future()
    rclpy.spin_until_future_complete(node, future, timeout_sec=0.01)
    assert not future.done()
    future.add_done_callback(lambda f: seen.append(f.result()))
    seen = []
    node.create_timer(0.001, lambda: future.set_result(3))
    rclpy.spin_until_future_complete(node, future)
    assert seen == [3]


def test_what_a_callback_raises_comes_out_of_spin(node):
    def fail():
        raise KeyError('inside')

    node.create_timer(0.001, fail)
    with pytest.raises(KeyError, match='inside'):
        rclpy.spin(node)


def test_shutdown_within_a_callback_ends_spin(node):
    node.create_timer(0.001, rclpy.shutdown)
    rclpy.spin(node)
    assert not rclpy.ok()


def test_shutdown_from_another_thread_ends_spin(node):
    threading.Timer(0.05, rclpy.shutdown).start()
    with suppress(ExternalShutdownException):
        rclpy.spin(node)
    assert not rclpy.ok()


def test_a_destroyed_publisher_raises(node):
    publisher = node.create_publisher(String, 'a', 10)
    publisher.destroy()
    with pytest.raises(InvalidHandle):
        publisher.publish(String())


def test_after_shutdown_nothing_is_published_or_made(node):
    publisher = node.create_publisher(String, 'a', 10)
    rclpy.shutdown()
    with pytest.raises(RCLError, match='context is invalid'):
        publisher.publish(String())
    with pytest.raises(NotInitializedException, match='cannot create node'):
        Node('late')


def test_init_twice_and_shutdown_without_init_raise(ros):
    with pytest.raises(RuntimeError, match='only be called once'):
        rclpy.init(args=[])
    rclpy.shutdown()
    with pytest.raises(RuntimeError, match='must be initialized'):
        rclpy.shutdown()


def test_a_second_life_after_shutdown_works(ros):
    for _ in range(3):
        rclpy.try_shutdown()
        rclpy.init(args=[])
        node = Node('again')
        publisher = node.create_publisher(String, 'a', 10)
        publisher.publish(String(data='x'))
        node.destroy_node()
    rclpy.uninstall_signal_handlers()


def test_the_block_of_init_shuts_down_at_its_end_and_after_an_error(ros_domain):
    for error in (None, KeyError):
        start = rclpy.init(args=[])
        if start is None:
            rclpy.shutdown()
            pytest.skip('init of rclpy 7.1 gives no context manager')
        handler = signal.getsignal(signal.SIGINT)
        with nullcontext() if error is None else pytest.raises(error), start:
            node = Node('within')
            assert rclpy.ok()
            if error is not None:
                raise error
        assert not rclpy.ok()
        assert signal.getsignal(signal.SIGINT) is not handler, 'the former handler is back'
        with pytest.raises(NotInitializedException):
            Node('late')
        node.destroy_node()


def test_the_block_of_init_may_hold_a_context_that_was_shut_down(ros_domain):
    context = rclpy.context.Context()
    start = rclpy.init(args=[], context=context)
    if start is None:
        context.shutdown()
        pytest.skip('init of rclpy 7.1 gives no context manager')
    with start:
        context.shutdown()
    assert not context.ok()
