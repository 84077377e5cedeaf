"""The bring-up with its nodes, by `live` on either runtime and by launch files on ROS 2."""

import os
import re
import signal
import time
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from power_recordings.reading.reader import Recording
from soak_devices import told_lost
from wattwalk_core.processes import wait_until

LIVE = 'import sys; from wattwalk_bringup.commands.arguments import live as main; sys.exit(main())'
NODES = {'sim_bridge/sim', 'power_daq/daq', 'policy_runner/run', 'power_estimator/estimate'}
SLOW = 180.0
"""s that a step may take beside much other work."""
needs_launch = pytest.mark.skipif(
    'ROS_DISTRO' not in os.environ, reason='ros2 launch is a part of ROS 2'
)


@pytest.fixture(autouse=True)
def logs_of_the_test(tmp_path, monkeypatch):
    """Logs that `live` keeps after a failure go with the test's folder."""
    monkeypatch.setenv('TMPDIR', str(tmp_path))


def in_domain():
    """Command lines of the running processes of this test's ROS domain, by id."""
    mark = f'ROS_DOMAIN_ID={os.environ["ROS_DOMAIN_ID"]}'.encode()
    found = {}
    for folder in Path('/proc').iterdir():
        if folder.name.isdigit() and int(folder.name) != os.getpid():
            with suppress(OSError):
                if mark in (folder / 'environ').read_bytes().split(b'\0'):
                    found[int(folder.name)] = (folder / 'cmdline').read_text()
    return found


def nodes():
    """Ids of the running nodes by package and executable."""
    pattern = re.compile(r'/lib/(\w+/\w+)\0')
    return {
        match[1]: number
        for number, line in in_domain().items()
        if 'tether.py' not in line and (match := pattern.search(line)) and match[1] in NODES
    }


def assert_whole(bag, output):
    """The recording has all topics, and what is missing in it was counted."""
    assert (bag / 'metadata.yaml').exists()
    recording = Recording.open(bag)
    assert recording.card.controller == 'trot'
    steps = np.diff(recording.drive_supply().sequence.astype(np.int64))
    assert len(steps) > 50
    assert told_lost(output) is not None, output
    assert told_lost(output) <= (steps - 1).sum()
    names = {name.lstrip('/') for name in recording.topics}
    assert names >= {'joint_states', 'joint_commands', 'power_estimate', 'diagnostics', 'supply'}


def test_one_command_walks_measures_records_and_ends_by_an_interrupt(node_process, tmp_path):
    bag = tmp_path / 'bag'
    live = node_process(
        *('wattwalk_bringup', 'live', '--channel', f'{tmp_path}/bus'),
        *('--record', str(bag)),
    )
    live.wait_for_output('policy: trot: standing up', timeout=SLOW)
    live.wait_for_output('recorder: .*drive_supply [1-9].*power_estimate [1-9]', timeout=SLOW)
    live.interrupt()
    assert live.wait(SLOW) == 0, live.output
    assert_whole(bag, live.output)
    assert nodes() == {}
    ends = [line.split(':')[0] for line in live.own_lines if line.endswith('ended, code 0')]
    assert ends[:2] == ['policy', 'recorder'], 'the last damping command is recorded'


def test_a_node_that_is_killed_ends_all_and_is_named(node_process, tmp_path):
    live = node_process('wattwalk_bringup', 'live', '--channel', f'{tmp_path}/bus')
    live.wait_for_output('daq: reading', timeout=SLOW)
    assert {*nodes()} == NODES
    os.kill(nodes()['power_daq/daq'], signal.SIGKILL)
    assert live.wait(SLOW) == 1, live.output
    assert re.search(r'^live: daq failed with code -9: ', live.output, re.MULTILINE)
    assert nodes() == {}


def test_what_a_node_says_of_its_input_is_the_reason_given(node_process, tmp_path):
    live = node_process(
        'wattwalk_bringup', 'live', '--channel', f'{tmp_path}/bus', '--policy', 'no_such_policy'
    )
    assert live.wait(SLOW) == 1
    (reason,) = (line for line in live.own_lines if line.startswith('live: policy failed'))
    assert 'with code 2' in reason
    assert 'no_such_policy' in reason
    assert nodes() == {}


def test_nodes_end_by_themselves_when_live_is_killed(node_process, tmp_path):
    live = node_process.python('-c', LIVE, '--channel', f'{tmp_path}/bus')
    live.wait_for_output('policy: trot: (standing up|running)', timeout=SLOW)
    assert {*nodes()} == NODES
    os.kill(live.pid, signal.SIGKILL)
    assert wait_until(lambda: nodes() == {}, SLOW)


def test_an_interrupt_while_nodes_start_is_no_fault(node_process, tmp_path):
    live = node_process('wattwalk_bringup', 'live', '--channel', f'{tmp_path}/bus')
    live.wait_for_output('estimator: starting', timeout=SLOW)
    time.sleep(0.3)  # a process has no signal handlers at its very start
    live.interrupt()
    assert live.wait(SLOW) == 0, live.output
    ends = [line for line in live.own_lines if ': ended' in line]
    assert ends
    assert all(line.endswith(', code 0') for line in ends), live.output


@needs_launch
def test_an_interrupt_while_nodes_start_is_no_fault_of_the_launch(node_process, tmp_path):
    launch = node_process.ros2(
        'launch', 'wattwalk_bringup', 'sim.launch.py', f'channel:={tmp_path}/bus'
    )
    launch.wait_for_output('estimator.*process started', timeout=SLOW)
    time.sleep(0.3)  # a process has no signal handlers at its very start
    launch.interrupt()
    assert launch.wait(SLOW) == 0, launch.output
    assert 'process has died' not in launch.output


@needs_launch
def test_the_launch_file_walks_measures_records_and_ends_by_an_interrupt(node_process, tmp_path):
    bag = tmp_path / 'bag'
    launch = node_process.ros2(
        *('launch', 'wattwalk_bringup', 'sim.launch.py', f'channel:={tmp_path}/bus'),
        f'record:={bag}',
    )
    launch.wait_for_output('trot: standing up', timeout=SLOW)
    launch.wait_for_output('recorder.*drive_supply [1-9].*power_estimate [1-9]', timeout=SLOW)
    launch.interrupt()
    assert launch.wait(SLOW) == 0, launch.output
    assert_whole(bag, launch.output)
    assert nodes() == {}


@needs_launch
def test_a_node_that_is_killed_ends_the_launch_with_code_1(node_process, tmp_path):
    launch = node_process.ros2(
        *('launch', 'wattwalk_bringup', 'sim.launch.py', f'channel:={tmp_path}/bus'),
    )
    launch.wait_for_output(r'daq.*reading', timeout=SLOW)
    os.kill(nodes()['power_daq/daq'], signal.SIGKILL)
    assert launch.wait(SLOW) == 1, launch.output
    assert 'daq failed with code -9' in launch.output
    assert nodes() == {}


@needs_launch
def test_nodes_end_by_themselves_when_the_launch_is_killed(node_process, tmp_path):
    launch = node_process.ros2(
        *('launch', 'wattwalk_bringup', 'sim.launch.py', f'channel:={tmp_path}/bus'),
    )
    launch.wait_for_output('daq.*reading', timeout=SLOW)
    assert {*nodes()} == NODES
    os.kill(launch.pid, signal.SIGKILL)
    assert wait_until(lambda: nodes() == {}, SLOW)


@needs_launch
@pytest.mark.skipif(find_spec('rosbag2_py') is None, reason='this ROS 2 has no rosbag2')
def test_rosbag2_records_the_launch_with_queues_that_lose_nothing_silently(node_process, tmp_path):
    bag = tmp_path / 'bag'
    launch = node_process.ros2(
        *('launch', 'wattwalk_bringup', 'sim.launch.py', f'channel:={tmp_path}/bus'),
        *(f'record:={bag}', 'recorder:=rosbag2'),
    )
    launch.wait_for_output('daq.*reading', timeout=SLOW)
    assert wait_until(lambda: sum(f.stat().st_size for f in bag.glob('*')) > 300_000, SLOW)
    launch.interrupt()
    assert launch.wait(SLOW) == 0, launch.output
    assert 'Overriding subscription profile' in launch.output
    recording = Recording.open(bag)
    assert len(recording.drive_supply().sequence) > 50


@needs_launch
@pytest.mark.parametrize('name', ['sim', 'robot'])
def test_arguments_of_a_launch_file_have_description_and_default(name, node_process):
    show = node_process.ros2('launch', 'wattwalk_bringup', f'{name}.launch.py', '--show-args')
    assert show.wait() == 0, show.output
    named = re.findall(r"'(\w+)':\n +(\S.*)\n +\(default: '", show.output)
    assert {'policy', 'model', 'mapping', 'record', 'interface', 'channel'} <= {*dict(named)}


@needs_launch
def test_a_bad_argument_of_a_launch_is_told_in_one_line(node_process):
    launch = node_process.ros2('launch', 'wattwalk_bringup', 'sim.launch.py', 'duration:=soon')
    assert launch.wait() == 1
    assert "duration: expected 0 to 1e+07 s, there is 'soon'" in launch.output
