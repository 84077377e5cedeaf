"""The live node in a process of its own."""

import re

import can
import pytest
from sim_bridge.commands.arguments import sim as sim_command

RUNNING = r'anymal_c, unit 2, on unixsocket'


@pytest.fixture
def channel(tmp_path):
    return str(tmp_path / 'bus')


@pytest.fixture
def sim(node_process, channel):
    node = node_process(
        *('sim_bridge', 'sim', '--ros-args', '-p', f'channel:={channel}', '-p', 'unit:=2'),
        *('-p', 'push_velocity:=0.3', '-p', 'publish_clock:=true'),
    )
    node.wait_for_output(RUNNING)
    return node


def test_frames_come_over_the_socket_and_the_node_ends_on_ctrl_c(sim, channel):
    counters = []
    with can.Bus(interface='unixsocket', channel=channel, fd=True) as bus:
        while len(counters) < 500:
            message = bus.recv(10.0)
            assert message is not None
            if message.arbitration_id == 256:
                counters.append(int.from_bytes(message.data[4:6], 'little'))
    assert counters == [(counters[0] + i) % 65536 for i in range(500)]
    sim.interrupt()
    assert sim.wait() == 0


def test_topics_beside_the_bus_are_published(sim, node_process):
    expected = {
        '/imu': r'frame_id: base',
        '/foot_force': r'- LF_FOOT',
        '/supply': r'current: -\d',
        '/clock': r'nanosec',
        '/diagnostics': r'real_time_factor',
    }
    echoes = {topic: node_process.ros2('topic', 'echo', topic) for topic in expected}
    for topic, echo in echoes.items():
        echo.wait_for_output(expected[topic])


def test_a_push_is_answered_with_its_velocity(sim, node_process):
    push = ('service', 'call', '/sim_bridge/push', 'std_srvs/srv/Trigger', '{}')
    call = node_process.ros2(*push)
    call.wait_for_output(r'success=True.*\+0\.30, \+0\.00 m/s')
    sim.wait_for_output(r'pushed by')


@pytest.mark.parametrize(
    ('name', 'value', 'quoted'),
    [
        ('plant', 'nowhere.yaml', r"no plant 'nowhere.yaml'"),
        ('interface', 'telepathy', r"interface is 'telepathy'"),
        ('terrain', 'moon', r"terrain is 'moon'"),
        ('world', 'sea', r"world is 'sea'"),
        ('dbc', '/nonexistent.dbc', r'/nonexistent.dbc'),
        ('unit', '-3', r'unit'),
        ('seed', 'many', r'seed'),
        ('push_velocity', '9.0', r'push_velocity'),
        ('publish_clock', '7', r'publish_clock'),
    ],
)
def test_a_wrong_parameter_ends_the_node_with_one_line(ros_domain, capfd, name, value, quoted):
    assert sim_command(['--ros-args', '-p', f'{name}:={value}']) == 2
    error = capfd.readouterr().err
    assert len(error.splitlines()) == 1
    assert re.search(quoted, error)
