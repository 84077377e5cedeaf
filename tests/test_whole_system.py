"""The nodes together, each in a process of its own, as a user runs them."""

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
from power_recordings.alignment.align import load_aligned
from power_recordings.reading.reader import Recording
from priority import prefer
from soak_devices import told_lost

ROOT = Path(__file__).resolve().parents[1]
NETWORK = ROOT / 'bags' / 'ppn_small'
ATTEMPTS = 5
CONTRACT = {
    'drive_supply': 'drive_power_msgs/msg/DriveSupply',
    'joint_states': 'sensor_msgs/msg/JointState',
    'joint_commands': 'sensor_msgs/msg/JointState',
    'supply': 'sensor_msgs/msg/BatteryState',
    'power_estimate': 'drive_power_msgs/msg/PowerEstimate',
    'imu': 'sensor_msgs/msg/Imu',
    'odom': 'nav_msgs/msg/Odometry',
    'foot_force': 'sensor_msgs/msg/JointState',
    'diagnostics': 'diagnostic_msgs/msg/DiagnosticArray',
}


def bus_arguments(folder: Path) -> list[str]:
    return ['--ros-args', '-p', 'interface:=unixsocket', '-p', f'channel:={folder}/bus']


@pytest.fixture
def walking(node_process, tmp_path):
    """The live system, started from its far end so that each node has to wait for the next."""
    bus = bus_arguments(tmp_path)
    estimate = node_process(
        'power_estimator', 'estimate', '--ros-args', '-p', f'model:=ppn:{NETWORK}'
    )
    policy = node_process(
        'policy_runner', 'run', '--policy', 'trot', '--start', '--restart-after', '1'
    )
    daq = node_process('power_daq', 'daq', *bus)
    sim = node_process('sim_bridge', 'sim', *bus)
    policy.wait_for_output('running', timeout=120.0)
    return {'sim': sim, 'daq': daq, 'policy': policy, 'estimate': estimate}


def pace(recording):
    """The share of a recording for which joint states came in steps of at most 2.5 periods."""
    steps = np.diff(recording.joint_states().stamp_ns) / 1e9
    return steps[steps <= 2.5 / 400].sum() / recording.duration


def cut_out(recording):
    """Samples left out on reading: a busy DAQ stamped them late, and then knew better."""
    words = r'drive_supply: (\d+) samples whose stamps run backwards'
    return sum(int(found[1]) for told in recording.problems if (found := re.search(words, told)))


@pytest.fixture
def measured(walking, node_process, tmp_path):
    """
    A recording of the walk at the robot's pace, and what its recorder said.

    Other work of the machine can keep joint states from the policy, which then damps the robot
    and starts anew, and can slow the walk down: then another recording is made, ATTEMPTS in all.
    """
    found = []
    for attempt in range(ATTEMPTS):
        bag, seen = tmp_path / f'bag{attempt}', len(walking['policy'].lines)
        recorder = node_process('power_daq', 'record', '-o', str(bag), '--duration', '10')
        prefer(*walking.values(), recorder)
        assert recorder.wait(90) == 0, recorder.output
        for name, node in walking.items():
            assert node.returncode is None, f'{name} ended:\n{node.output}'
        recording = Recording.open(bag)
        damped = any('damping' in line for line in walking['policy'].lines[seen:])
        if not damped and pace(recording) >= 0.9:
            return recording, recorder.output
        found.append(f'damped: {damped}, pace {pace(recording):.2f}')
    return pytest.fail(f'nothing was measured in {ATTEMPTS} attempts: {"; ".join(found)}')


@pytest.mark.alone
def test_a_walk_is_measured_estimated_and_recorded_whole(measured):
    recording, said = measured
    types = {name.lstrip('/'): topic.type_name for name, topic in recording.topics.items()}
    assert {name: types.get(name) for name in CONTRACT} == CONTRACT

    drives = recording.drive_supply()
    steps = np.diff(drives.sequence.astype(np.int64))
    assert np.all(steps >= 1)
    missing, lost = int((steps - 1).sum()), told_lost(said)
    assert lost is not None, said
    assert lost <= missing <= lost + cut_out(recording), 'what is missing was counted'
    assert np.all(np.diff(drives.stamp_ns) > 0)
    assert lost <= 0.05 * len(drives.stamp_ns)

    data = load_aligned([recording.path], rate=50.0)
    assert data.measured_drives() == data.names
    drawn = data.power.sum(axis=1)
    assert 100.0 < np.nanmean(drawn) < 1500.0
    electronics = np.nanmedian(data.supply - drawn)
    assert 150.0 < electronics < 250.0, 'the supply feeds the drives and 192 W of electronics'

    estimates = recording.power_estimate()
    good = estimates.status == 0
    assert np.mean(good) > 0.5
    stamps = estimates.stamp_ns[good] / 1e9
    estimated = np.interp(data.time, stamps, estimates.total[good])
    after = np.clip(np.searchsorted(stamps, data.time), 1, len(stamps) - 1)
    between = (data.time >= stamps[0]) & (data.time <= stamps[-1])
    there = between & (stamps[after] - stamps[after - 1] < 0.05)
    assert abs(np.nanmean((estimated - drawn)[there])) < 0.25 * np.nanmean(drawn[there])


MOTION = 'format: motion/1\ndrives: [LF_KFE]\nsegments: [{mode: rest, seconds: 60}]\n'


def allowed_by_the_security_policy():
    """For each node, the names that it may publish, subscribe to and reply to."""
    allowed = {}
    for profile in ElementTree.parse(ROOT / 'docs' / 'sros2_policy.xml').getroot().iter('profile'):
        node = profile.get('node')
        sides = allowed[node] = {}
        for part in profile:
            (side,) = part.attrib
            names = (entry.text.replace('~', f'/{node}') for entry in part)
            sides[side] = {'/' + name.lstrip('/') for name in names}
    return allowed


def test_the_security_policy_allows_what_the_nodes_have(walking, node_process, tmp_path):
    recorder = node_process('power_daq', 'record', '-o', str(tmp_path / 'bag'))
    recorder.wait_for_output('recording to')
    node_process('power_daq', 'supply', '--ros-args', '-p', 'host:=127.0.0.1')
    node_process('power_daq', 'watch')
    motion = tmp_path / 'rest.yaml'
    motion.write_text(MOTION)
    node_process('drive_bench', 'run', str(motion))  # waits to be started
    allowed = allowed_by_the_security_policy()
    del allowed['operator']
    assert set(allowed) >= {'power_daq', 'power_estimator', 'policy_runner', 'sim_bridge'}
    for node, sides in allowed.items():
        has = 'Subscribers' if node == 'watch' else 'Publishers'
        shown: dict[str, set[str]] = {}
        for _ in range(20):
            look = node_process.ros2('node', 'info', f'/{node}')
            look.wait()
            parts = re.split(
                r'^ +(Publishers|Subscribers|Service Servers):', look.output, flags=re.M
            )
            names = (set(re.findall(r'^ +(/\S+): ', part, re.M)) for part in parts[2::2])
            shown = dict(zip(parts[1::2], names, strict=True))
            if all(shown.get(heading) for heading in (has, 'Service Servers')):
                break
        assert node == 'watch' or '/diagnostics' in shown['Publishers']
        assert shown['Publishers'] <= sides['publish'], node
        assert shown['Subscribers'] <= sides['subscribe'], node
        assert shown['Service Servers'] <= sides['reply'], node


def test_the_policy_damps_and_the_daq_waits_when_the_robot_goes(walking, node_process, tmp_path):
    walking['sim'].kill()
    walking['policy'].wait_for_output('damping, stale input')
    walking['daq'].wait_for_output('bus (absent|lost|gone)')
    sim = node_process('sim_bridge', 'sim', *bus_arguments(tmp_path))
    seen = len(walking['daq'].lines)

    def measuring() -> bool:
        again = r'measuring|electrical at [1-9]'
        return any(re.search(again, line) for line in walking['daq'].lines[seen:])

    deadline = 300
    while not measuring() and deadline:
        node_process.ros2('node', 'list').wait()
        deadline -= 1
    assert measuring(), walking['daq'].output
    assert sim.returncode is None
