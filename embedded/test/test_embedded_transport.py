"""Reach of nodes, and the effect of a stalled subscriber on a publisher."""

import os
import signal
import threading

import pytest
from rclpy._rclpy_pybind11 import RCLError
from rclpy.qos import HistoryPolicy, QoSProfile
from std_msgs.msg import String

pytest.importorskip('rosidl_embedded', reason='ROS 2 has a transport of its own')
from rclpy.impl.transport import domain_configuration
from ros2cli.main import main


@pytest.mark.parametrize('given', [None, '', 'LOCALHOST'])
def test_nodes_stay_on_the_loopback_interface_unless_told_otherwise(monkeypatch, given):
    monkeypatch.delenv('ROS_AUTOMATIC_DISCOVERY_RANGE', raising=False)
    monkeypatch.delenv('ROS_STATIC_PEERS', raising=False)
    if given is not None:
        monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', given)
    configuration = domain_configuration()
    assert '<NetworkInterface name="lo" multicast="false"/>' in configuration
    assert '<AllowMulticast>false</AllowMulticast>' in configuration
    assert configuration.count('<Peer ') == 1
    assert '<Peer address="127.0.0.1"/>' in configuration


def test_subnet_reaches_out_and_static_peers_are_added(monkeypatch):
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'SUBNET')
    monkeypatch.setenv('ROS_STATIC_PEERS', '192.0.2.1;192.0.2.2')
    configuration = domain_configuration()
    assert '"lo"' not in configuration
    assert '<Peer address="192.0.2.1"/><Peer address="192.0.2.2"/>' in configuration


def test_off_shuts_all_others_out(monkeypatch):
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'OFF')
    configuration = domain_configuration()
    assert f'<Tag>off_{os.getpid()}</Tag>' in configuration
    assert '<Peer ' not in configuration


@pytest.mark.parametrize(
    ('name', 'value'), [('ROS_AUTOMATIC_DISCOVERY_RANGE', 'FAR'), ('ROS_DOMAIN_ID', 'kitchen')]
)
def test_an_environment_that_cannot_be_meant_is_quoted(
    ros_domain, monkeypatch, capfd, name, value
):
    monkeypatch.setenv(name, value)
    assert main(['node', 'list']) == 1
    assert f"{name} is '{value}', it must be" in capfd.readouterr().err


@pytest.mark.parametrize('strategy', ['Enforce', 'Permissive', None])
def test_nothing_starts_where_security_is_asked_for(node_process, strategy):
    environment = {'ROS_SECURITY_ENABLE': 'true', 'ROS_SECURITY_KEYSTORE': '/keys'}
    if strategy is not None:
        environment['ROS_SECURITY_STRATEGY'] = strategy
    lines = (
        'import rclpy',
        'try:',
        '    rclpy.init()',
        'except RuntimeError as error:',
        '    print(error, rclpy.ok(), rclpy.get_default_context()._participant)',
    )
    script = node_process.python('-c', '\n'.join(lines), **environment)
    assert script.wait() == 0
    assert "ROS_SECURITY_ENABLE is 'true'" in script.output
    assert script.output.rstrip().endswith('False None'), 'no participant was made'
    node = node_process.command('ros2', 'run', 'power_daq', 'daq', **environment)
    assert node.wait() == 1
    assert 'the embedded runtime has no security' in node.lines[-1]
    tool = node_process.command('ros2', 'node', 'list', **environment)
    assert tool.wait() == 1
    assert 'the embedded runtime has no security' in tool.output


def test_security_that_is_switched_off_is_no_obstacle(node_process):
    for value in ('false', ''):
        tool = node_process.command('ros2', 'node', 'list', ROS_SECURITY_ENABLE=value)
        assert tool.wait() == 0, tool.output


@pytest.fixture
def stopped_subscriber(node, node_process):
    def start(publisher):
        echo = node_process.ros2('topic', 'echo', '/load', 'std_msgs/msg/String')
        first = threading.Event()
        while not first.wait(0.02):
            if publisher.get_subscription_count():
                publisher.publish(String(data='first'))
                first.set()
        echo.wait_for_output('first')
        os.kill(echo.pid, signal.SIGSTOP)
        stopped.append(echo)

    stopped = []
    yield start
    for echo in stopped:
        echo.kill()


def test_a_subscriber_that_stands_still_does_not_hold_up_keep_last(node, stopped_subscriber):
    publisher = node.create_publisher(String, '/load', QoSProfile(depth=1000))
    stopped_subscriber(publisher)
    for _ in range(5000):
        publisher.publish(String(data='x' * 1000))


def test_keep_all_raises_instead_of_standing_still_as_well(node, stopped_subscriber):
    profile = QoSProfile(history=HistoryPolicy.KEEP_ALL)
    publisher = node.create_publisher(String, '/load', profile)
    stopped_subscriber(publisher)

    def publish_much():
        for _ in range(20_000):
            publisher.publish(String(data='x' * 1000))

    with pytest.raises(RCLError, match='/load'):
        publish_much()
