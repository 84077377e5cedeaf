"""
Nodes of both runtimes in one graph, each seeing the other.

Runs from the embedded runtime, with a ROS 2 beside it that WATTWALK_ROS_SETUP leads to.
"""

import re
import subprocess
from pathlib import Path

import pytest
import runtimes
from contents import MESSAGES

PEER = Path(__file__).parent / 'props' / 'peer.py'
COUNTER = Path(__file__).parents[1] / 'embedded' / 'test' / 'nodes' / 'counter.py'
ANSWERS = ('True pushed by 0.30 m/s', 'True enabled', 'False off')
PYTHON = {'embedded': runtimes.embedded, 'ROS 2': runtimes.real}
ROS2 = {'embedded': runtimes.embedded_ros2, 'ROS 2': runtimes.real_ros2}
OTHER = {'embedded': 'ROS 2', 'ROS 2': 'embedded'}

pytestmark = pytest.mark.skipif(bool(runtimes.missing()), reason=runtimes.missing())


@pytest.fixture(params=list(PYTHON))
def here(request):
    """The runtime that a node runs on; the other one looks at it."""
    return request.param


@pytest.fixture
def start(node_process):
    def start(runtime, *arguments):
        return node_process.command(*PYTHON[runtime](*arguments))

    return start


@pytest.fixture
def talker(start, here):
    process = start(here, PEER, 'talk')
    process.wait_for_output('talking')
    return process


@pytest.fixture
def without_daemon(node_process):
    """End the daemon of the other runtime's tools, which outlives them."""
    yield
    subprocess.run(runtimes.real_ros2('daemon', 'stop'), check=True, stdout=subprocess.DEVNULL)


@pytest.fixture
def look(node_process, without_daemon, here):
    """Run `ros2` of the other runtime until its output, which is returned, has all patterns."""

    def look(*arguments, until=()):
        for _ in range(20):
            process = node_process.command(*ROS2[OTHER[here]](*arguments))
            process.wait()
            if all(re.search(pattern, process.output) for pattern in until):
                return process.output
        return pytest.fail(f'no {until} in the output of {arguments}:\n{process.output}')

    return look


def test_messages_of_each_type_what_was_latched_and_services_cross(start, here, talker):
    hearer = start(OTHER[here], PEER, 'hear')
    for topic in MESSAGES:
        hearer.wait_for_output(f'heard {topic}$')
    hearer.wait_for_output(r'heard latched 42\.0')
    for answer in ANSWERS:
        hearer.wait_for_output(f'answered {re.escape(answer)}')
    assert 'differs' not in hearer.output


def test_the_node_is_listed_with_its_topics_and_services(talker, look):
    look('node', 'list', until=[r'(?m)^/talker$'])
    services = [r'/push: std_srvs/srv/Trigger', r'/talker/get_parameters']
    topics = [r'/drive_supply: drive_power_msgs/msg/DriveSupply', r'/latched: \S*PowerEstimate']
    look('node', 'info', '/talker', until=[*topics, *services])
    listed = [f'(?m)^/{topic}$' for topic in MESSAGES]
    look('topic', 'list', until=listed)


def test_its_topics_are_echoed(talker, look):
    look(
        *('topic', 'echo', '--once', '/drive_supply', 'drive_power_msgs/msg/DriveSupply'),
        until=['sequence: 1099511627776', r'(?s)voltage:\s+- 48\.0\s+- 47\.5'],
    )


def test_its_parameters_are_listed_read_and_set_within_their_limits(talker, look):
    look('param', 'list', '/talker', until=[f'(?m)^ +{n}$' for n in ('gain', 'device', 'rates')])
    look('param', 'get', '/talker', 'gain', until=['Double value is: 1.5'])
    look('param', 'set', '/talker', 'gain', '2.5', until=['successful'])
    look('param', 'get', '/talker', 'gain', until=['Double value is: 2.5'])
    look('param', 'set', '/talker', 'gain', '11.0', until=['(?i)failed.*gain'])
    look('param', 'set', '/talker', 'device', 'other', until=['(?i)failed.*device'])
    look('param', 'describe', '/talker', 'gain', until=['gain, 1', r'(?i)max value: 10\.0'])
    look('param', 'dump', '/talker', until=[r'gain: 2\.5', r'enabled: false', r'- 400\.0'])


def test_its_services_are_called(talker, look):
    look(
        *('service', 'call', '/push', 'std_srvs/srv/Trigger', '{}'),
        until=[r"success=True, message='pushed by 0\.30 m/s'"],
    )


def test_a_thousand_messages_a_second_cross_without_loss(start, here):
    sink = start(OTHER[here], COUNTER, 'sink', '--count', '5000', '--depth', '1000')
    sink.wait_for_output('listening')
    source = start(
        *(here, COUNTER, 'source', '--count', '5000', '--period', '0.001', '--depth', '1000')
    )
    source.wait_for_output('sent 5000')
    sink.wait_for_output('received 5000 gaps 0 first 0')
