import array
import json
import os
import resource
import signal
from contextlib import suppress
from pathlib import Path

import pytest
import yaml
from drive_bench.run import recording as bench_recorder
from drive_bench.run.options import free_name
from drive_bench.run.recording import RecorderProcess
from peers import PATIENCE, Peer, wait_until
from power_recordings.reading.reader import Recording
from sensor_msgs.msg import JointState

from drive_power_msgs.msg import DriveSupply

PATIENT = ('--patience', '60', '--ros-args', '-p', 'stale_after:=1.0')
MOTION = """
format: motion/1
drives: [LF_KFE]
segments:
- {mode: velocity, speed: 0.5, seconds: 1.5}
- {mode: velocity, speed: -0.5, seconds: 1.5}
"""
LONG = MOTION.replace('seconds: 1.5', 'seconds: 12')
SOAK = """
format: motion/1
drives: [LF_KFE]
segments:
- {mode: position, amplitude: 0.3, frequency: 1.0, until_warmer: 20, seconds: 600}
"""


class Drive(Peer):
    """One joint that follows its commands at once, with a meter, at 100 Hz."""

    def __init__(self):
        super().__init__('drive', 'estop')
        self.position, self.velocity, self.sequence = 0.1, 0.0, 0
        self.commands, self.temperature = [], []
        self.joints = self.node.create_publisher(JointState, 'joint_states', 10)
        self.supply = self.node.create_publisher(DriveSupply, 'drive_supply', 1000)
        self.node.create_subscription(JointState, 'joint_commands', self.on_command, 10)
        self.open()

    def on_command(self, message):
        self.commands.append(message)
        if len(message.position):
            self.position, self.velocity = message.position[0], message.velocity[0]

    def speak(self):
        stamp = self.node.get_clock().now().to_msg()
        message = JointState(name=['LF_KFE'], position=[self.position], velocity=[self.velocity])
        message.effort = [1.0]
        message.header.stamp = stamp
        self.joints.publish(message)
        power = DriveSupply(name=['LF_KFE'], sequence=self.sequence)
        power.header.stamp = stamp
        power.device_time = array.array('Q', [self.sequence * 10_000_000])
        power.voltage, power.current = array.array('f', [48.0]), array.array('f', [0.5])
        power.status = array.array('B', [0])
        power.temperature = array.array('f', self.temperature)
        self.supply.publish(power)
        self.sequence += 1


@pytest.fixture
def drive(ros_domain):
    drive = Drive()
    yield drive
    drive.close()


@pytest.fixture
def bench(drive, node_process, tmp_path):
    def start(text, *arguments, **environment):
        (tmp_path / 'next.yaml').write_text(text)
        bag = ('--record', str(tmp_path / 'bag'))
        words = ('drive_bench', 'run', str(tmp_path / 'next.yaml'), *bag, *arguments)
        return node_process.command('ros2', 'run', *words, *PATIENT, **environment)

    return start


def card_in(tmp_path):
    return yaml.safe_load((tmp_path / 'bag' / 'card.yaml').read_text())


def assert_damped(drive):
    wait_until(lambda: len(drive.commands[-1].position) == 0, 'a damping command')
    assert list(drive.commands[-1].velocity) == [0.0]


def recorder_of(node):
    """Process id of the recorder that a bench command has started."""
    for entry in Path('/proc').iterdir():
        with suppress(OSError, ValueError):
            words = (entry / 'cmdline').read_bytes().split(b'\0')
            if bench_recorder.NAME.encode() in b' '.join(words) and node.pid == group_of(entry):
                return int(entry.name)
    raise AssertionError('no recorder runs')


def group_of(entry):
    """Process group of the parent of a process."""
    parent = (entry / 'stat').read_text().rsplit(')', 1)[1].split()[1]
    return os.getpgid(int(parent))


def test_a_motion_is_done_recorded_filed_checked_and_followed_by_the_next_command(
    drive, bench, tmp_path
):
    node = bench(MOTION, '--card', 'unit=B', '--json', str(tmp_path / 'check.json'))
    assert node.wait(2 * PATIENCE) == 0, node.output
    assert f'next: ros2 run power_lab diagnose {tmp_path}/bag --model base.yaml' in node.output
    card = card_in(tmp_path)
    assert card['complete'] is True
    assert (card['motion'], card['load'], card['unit']) == ('next', 'none', 'B')
    assert card['drives'] == ['LF_KFE']
    assert card['check']['supply_lost'] == 0
    assert card['check']['speed_reached'] == pytest.approx(0.5, abs=0.01)
    recording = Recording.open(tmp_path / 'bag')
    assert recording.problems == ()
    commands = recording.joint_commands()
    before = commands.stamp_ns[0] - recording.joint_states().stamp_ns[0]
    assert before > 0.5e9, 'it records before it moves'
    found = json.loads((tmp_path / 'check.json').read_text())
    assert found['complete']
    assert {row['name'] for row in found['rows']} >= {'drive_supply', 'speed', 'torque', 'power'}
    assert_damped(drive)


def moving(drive, node):
    node.wait_for_output('segment 1 of', PATIENCE)
    wait_until(lambda: drive.position > 0.4, 'motion')


def test_nobody_else_can_start_what_is_not_recorded_yet(drive, bench):
    node = bench(LONG)
    moving(drive, node)
    offered = {name for name, _ in drive.node.get_service_names_and_types()}
    assert {'/stop', '/estop'} <= offered
    assert '/start' not in offered
    assert drive.call('estop').success
    assert node.wait(PATIENCE) == 1


def test_an_emergency_stop_damps_and_the_bag_is_kept_as_incomplete(drive, bench, tmp_path):
    node = bench(LONG)
    moving(drive, node)
    assert drive.call('estop').success
    assert node.wait(PATIENCE) == 1
    assert_damped(drive)
    card = card_in(tmp_path)
    assert card['complete'] is False
    assert card['ended'] == 'emergency stop: asked for'
    assert len(Recording.open(tmp_path / 'bag').joint_commands()) > 10
    assert 'is kept, incomplete: emergency stop' in node.output


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_damps_first_and_then_closes_the_bag(drive, bench, tmp_path, number):
    node = bench(LONG)
    moving(drive, node)
    node.send_signal(number)
    assert node.wait_after(number, PATIENCE) in (130, None)
    assert_damped(drive)
    wait_until(lambda: 'is kept, incomplete' in node.output, 'the end of the node')
    assert card_in(tmp_path)['complete'] is False
    recording = Recording.open(tmp_path / 'bag')
    assert recording.problems == (), 'the bag has its index and metadata.yaml'
    assert len(drive.commands[-1].position) == 0


def test_a_soak_waits_for_a_thermometer_and_is_damped_once_that_falls_silent(
    drive, bench, tmp_path
):
    node = bench(SOAK)
    node.wait_for_output('waiting: .*has no winding temperature of LF_KFE', PATIENCE)
    assert not drive.commands
    drive.temperature = [30.0]
    node.wait_for_output('segment 1 of 1', PATIENCE)
    wait_until(lambda: drive.position > 0.3, 'motion')
    drive.temperature = []
    assert node.wait(PATIENCE) == 1
    assert_damped(drive)
    assert card_in(tmp_path)['ended'] == (
        'stale input: drive_supply has no winding temperature of LF_KFE'
    )


def test_joint_states_that_stop_damp_with_the_reason_in_the_card(drive, bench, tmp_path):
    node = bench(LONG)
    moving(drive, node)
    drive.timer.cancel()
    assert node.wait(PATIENCE) == 1
    assert_damped(drive)
    assert card_in(tmp_path)['ended'].startswith('stale input: joint_states is')


def test_a_recorder_that_is_killed_stops_the_motion_and_its_bag_is_kept(drive, bench, tmp_path):
    node = bench(LONG)
    moving(drive, node)
    os.kill(recorder_of(node), signal.SIGKILL)
    assert node.wait(PATIENCE) == 1
    assert_damped(drive)
    card = card_in(tmp_path)
    assert card['complete'] is False
    assert card['ended'] == 'recording: the recorder was ended by SIGKILL'
    assert 'no metadata.yaml: the recorder was killed' in str(card['amiss'])
    assert len(Recording.open(tmp_path / 'bag').joint_states()) > 10


def test_a_file_that_may_not_grow_further_stops_the_motion(drive, bench, tmp_path):
    node = bench(LONG)
    moving(drive, node)
    size = sum(path.stat().st_size for path in (tmp_path / 'bag').glob('*.mcap'))
    resource.prlimit(recorder_of(node), resource.RLIMIT_FSIZE, (size + 1, size + 1))
    assert node.wait(PATIENCE) == 1
    assert_damped(drive)
    card = card_in(tmp_path)
    assert card['complete'] is False
    assert 'may not grow further' in card['ended']


@pytest.mark.parametrize(
    ('text', 'arguments', 'words'),
    [
        (MOTION.replace('0.5', '50.0'), (), '50 rad/s asked of LF_KFE; its limits are 0..8'),
        (MOTION.replace('1.5', '80'), (), 'would go to 40.09 rad; its limits are -9.42..9.42'),
        (MOTION, ('--mode', 'torque'), 'one way only'),
        (MOTION, ('--drive', 'TAIL'), "no drive 'TAIL' in joint_states"),
    ],
)
def test_what_may_not_be_executed_is_refused_before_a_bag_is_begun(
    drive, bench, tmp_path, text, arguments, words
):
    node = bench(text, *arguments)
    assert node.wait(PATIENCE) == 2
    assert words in node.output
    assert not drive.commands
    assert not (tmp_path / 'bag').exists()


def test_what_leaves_the_range_is_fitted_where_that_is_allowed(drive, bench, tmp_path):
    wide = MOTION.replace('0.5', '4.0').replace('1.5', '3.0')
    node = bench(wide, '--fit')
    node.wait_for_output('fitted: .* and back: 2 times 1.50 s', PATIENCE)
    assert node.wait(2 * PATIENCE) == 0, node.output
    assert card_in(tmp_path)['fitted'] == [
        '+4 rad/s, 3 s and back: 2 times 1.50 s, first to -4 rad/s'
    ]


def test_a_bag_that_is_there_is_never_touched(node_process, tmp_path):
    (tmp_path / 'bag').mkdir()
    node = node_process('drive_bench', 'run', 'still', '--record', str(tmp_path / 'bag'))
    assert node.wait(PATIENCE) == 2
    assert 'exists already' in node.output


def test_the_list_names_each_motion_with_its_modes(node_process):
    node = node_process('drive_bench', 'run', '--list')
    assert node.wait(PATIENCE) == 0
    assert 'hot_soak' in node.output
    assert 'position, velocity, torque' in node.output


def test_a_new_bag_gets_a_name_that_is_free(tmp_path):
    assert free_name(tmp_path, 'sine') == tmp_path / 'sine'
    (tmp_path / 'sine').mkdir()
    (tmp_path / 'sine_2').mkdir()
    assert free_name(tmp_path, 'sine') == tmp_path / 'sine_3'


def test_a_recorder_that_cannot_begin_says_why(ros_domain, tmp_path):
    (tmp_path / 'bag').mkdir()
    recorder = RecorderProcess(tmp_path / 'bag', {'robot': 'bench'}, 30.0)
    wait_until(lambda: recorder.ended, 'its end')
    assert 'exists already: choose another name' in recorder.ended
    recorder.stop()
