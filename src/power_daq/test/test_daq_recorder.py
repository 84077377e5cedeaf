import array
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np
import pytest
import rclpy
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from power_daq.commands.arguments import record as main
from power_daq.commands.record import card_of, topics_of
from power_daq.nodes.card_topic import publish_card
from power_recordings.card import Card
from power_recordings.reading.reader import Recording
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from wattwalk_core.errors import InputError
from wattwalk_core.files import check_room

from drive_power_msgs.msg import DriveSupply

LONG = 30.0  # s, after which a test gives up


def wait_for(condition: Callable[[], object]) -> None:
    deadline = time.monotonic() + LONG
    while not condition():
        assert time.monotonic() < deadline, 'waited in vain'
        time.sleep(0.01)


class Robot:
    """Publishes in a namespace of its own."""

    def __init__(self) -> None:
        self.namespace = f'/test_{uuid4().hex[:8]}'
        self.context = Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node('robot', namespace=self.namespace, context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.heard: dict[str, str] = {}
        self.sequence = 0
        self.sent: list[float] = []

    def publisher(self, kind: Any, topic: str, reliability: str = 'RELIABLE') -> Any:
        qos = QoSProfile(depth=1000, reliability=ReliabilityPolicy[reliability])
        return self.node.create_publisher(kind, topic, qos)

    def supply(self) -> DriveSupply:
        now = time.time_ns()
        message = DriveSupply(name=['LF_HAA', 'LF_KFE'], sequence=self.sequence)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(now, 1_000_000_000)
        message.device_time = array.array('Q', [self.sequence * 1_000_000])
        message.voltage = array.array('f', [48.0, 48.0])
        message.current = array.array('f', [1.0, 2.0])
        message.status = array.array('B', [0, 0])
        self.sequence += 1
        self.sent.append(time.monotonic())
        return message

    def stream(self, publisher: Any, until: Callable[[], object]) -> None:
        deadline = time.monotonic() + LONG
        while not until():
            assert time.monotonic() < deadline, 'streamed in vain'
            publisher.publish(self.supply())
            time.sleep(0.002)

    def wait_for_diagnostics(self, key: str, value: str) -> None:
        self.executor.add_node(self.node)
        self.node.create_subscription(DiagnosticArray, 'diagnostics', self._heard, 10)
        deadline = time.monotonic() + LONG
        while self.heard.get(key) != value:
            assert time.monotonic() < deadline, self.heard
            self.executor.spin_once(timeout_sec=0.1)

    def _heard(self, message: DiagnosticArray) -> None:
        self.heard = {pair.key: pair.value for status in message.status for pair in status.values}

    def close(self) -> None:
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def robot() -> Iterator[Robot]:
    made = Robot()
    yield made
    made.close()


class Recorder:
    """`ros2 run power_daq record` as a process."""

    def __init__(
        self, robot: Robot, path: Path, *arguments: str, limit: int = 0, before: str = ''
    ) -> None:
        self.path = path
        run = f'{before}\nfrom power_daq.commands.arguments import record as r\nexit(r())'
        command = [sys.executable, '-c', run, '-o', str(path), *arguments]
        command += ['--ros-args', '-r', f'__ns:={robot.namespace}']
        self.process = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            preexec_fn=(lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)))
            if limit
            else None,
        )

    def end(self, number: signal.Signals = signal.SIGINT) -> tuple[int, str, str]:
        self.process.send_signal(number)
        return self.result()

    def result(self) -> tuple[int, str, str]:
        out, err = self.process.communicate(timeout=LONG)
        return self.process.returncode, out, err


@pytest.fixture
def record(robot: Robot) -> Iterator[Callable[..., Recorder]]:
    started: list[Recorder] = []

    def start(path: Path, *arguments: str, **options: Any) -> Recorder:
        started.append(Recorder(robot, path, *arguments, **options))
        return started[-1]

    yield start
    for recorder in started:
        if recorder.process.poll() is None:
            recorder.process.kill()
            recorder.process.communicate()


def test_what_is_published_is_in_the_bag_after_ctrl_c(
    robot: Robot, record: Callable[..., Recorder], tmp_path: Path
) -> None:
    supply = robot.publisher(DriveSupply, 'drive_supply')
    joints = robot.publisher(JointState, 'joint_states')
    told = Card.of_source({'LF_HAA': 'motor'}, {'LF_HAA': 'A'})
    publish_card(robot.node, replace(told, calibration='cal.yaml (sha256 0123456789ab)'))
    recorder = record(tmp_path / 'walk', '--card', 'robot=anymal_c', 'unit=A', 'load_kg=4')
    wait_for(lambda: supply.get_subscription_count() and joints.get_subscription_count())
    for i in range(300):
        if i == 200:
            robot.sequence += 7
        supply.publish(robot.supply())
        joints.publish(JointState(name=['LF_HAA'], position=[0.1 * i]))
        time.sleep(0.001)
    robot.wait_for_diagnostics(f'{robot.namespace}/joint_states messages', '300')
    assert robot.heard[f'{robot.namespace}/drive_supply messages'] == '300'
    assert robot.heard['samples lost'] == '7'
    code, out, err = recorder.end()
    assert code == 0, err
    assert 'drive_supply lost 7 samples in 1 places (300 came)' in out
    recording = Recording.open(tmp_path / 'walk')
    assert recording.topics[f'{robot.namespace}/drive_supply'].count == 300
    assert recording.topics[f'{robot.namespace}/joint_states'].count == 300
    np.testing.assert_array_equal(
        np.diff(recording.drive_supply().sequence), [1] * 199 + [8] + [1] * 99
    )
    card = recording.card
    assert (card.robot, card.unit, card.drives) == ('anymal_c', 'A', ('LF_HAA', 'LF_KFE'))
    assert card.calibration == 'cal.yaml (sha256 0123456789ab)'
    assert (card.torque, card.torque_unit) == ({'LF_HAA': 'motor'}, {'LF_HAA': 'A'})
    assert card.other == {'load_kg': '4'}
    assert card.created
    assert card.software.startswith('power_daq')


def test_a_killed_recorder_leaves_a_card_with_torque_calibration_and_drives(
    robot: Robot, record: Callable[..., Recorder], tmp_path: Path
) -> None:
    supply = robot.publisher(DriveSupply, 'drive_supply')
    told = Card.of_source({'LF_HAA': 'motor'}, {}, ('LF_KFE',))
    publish_card(robot.node, replace(told, calibration='cal.yaml'))
    bag = tmp_path / 'walk'
    recorder = record(bag, '--topics', 'drive_supply')
    wait_for(supply.get_subscription_count)
    robot.stream(supply, lambda: Card.load(bag).drives and Card.load(bag).torque)
    recorder.process.kill()
    recorder.process.wait()
    card = Card.load(bag)
    assert (card.torque, card.calibration) == ({'LF_HAA': 'motor'}, 'cal.yaml')
    assert (card.drives, card.derived_velocity) == (('LF_HAA', 'LF_KFE'), ('LF_KFE',))


def test_a_card_of_a_source_that_cannot_be_read_is_told_and_left_out(
    robot: Robot, record: Callable[..., Recorder], tmp_path: Path
) -> None:
    supply = robot.publisher(DriveSupply, 'drive_supply')
    qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    card = robot.node.create_publisher(String, 'card', qos)
    card.publish(String(data='torque: {LF_HAA: moon}'))
    recorder = record(tmp_path / 'walk', '--topics', 'drive_supply')
    wait_for(card.get_subscription_count)
    robot.stream(supply, lambda: len(robot.sent) > 300 and Card.load(recorder.path).drives)
    _, _, err = recorder.end()
    assert "topic card: torque.LF_HAA: expected 'joint' or 'motor', there is 'moon'" in err
    assert Card.load(recorder.path).torque == {}


def test_a_killed_recorder_loses_less_than_a_second(
    robot: Robot, record: Callable[..., Recorder], tmp_path: Path
) -> None:
    supply = robot.publisher(DriveSupply, 'drive_supply')
    recorder = record(tmp_path / 'walk', '--topics', 'drive_supply')
    wait_for(supply.get_subscription_count)
    robot.stream(
        supply, lambda: len(robot.sent) > 300 and time.monotonic() > robot.sent[300] + 1.5
    )
    killed = time.monotonic()
    recorder.process.kill()
    recorder.process.wait()
    recording = Recording.open(tmp_path / 'walk')
    there = recording.drive_supply().sequence
    assert there.tolist() == list(range(len(there)))
    owed = sum(sent < killed - 1.0 for sent in robot.sent)
    assert owed > 300, 'otherwise the test tells nothing'
    assert len(there) >= owed
    assert recording.problems == (
        'no metadata.yaml: the recorder was killed',
        'walk_0.mcap was not closed (no index)',
    )
    assert recording.card.created


def test_best_effort_publishers_are_recorded_as_such(
    robot: Robot, record: Callable[..., Recorder], tmp_path: Path
) -> None:
    supply = robot.publisher(DriveSupply, 'drive_supply', 'BEST_EFFORT')
    recorder = record(tmp_path / 'walk', '--topics', 'drive_supply')
    wait_for(supply.get_subscription_count)
    first = time.monotonic()
    robot.stream(supply, lambda: time.monotonic() - first > 0.5)
    code, _, err = recorder.end(signal.SIGTERM)
    assert code == 0, err
    content = yaml.safe_load((tmp_path / 'walk' / 'metadata.yaml').read_text())
    (topic,) = content['rosbag2_bagfile_information']['topics_with_message_count']
    assert topic['message_count'] > 50
    assert topic['topic_metadata']['offered_qos_profiles'][0]['reliability'] == 'best_effort'


def test_a_disk_that_fills_ends_the_recording_with_a_readable_bag(
    robot: Robot, record: Callable[..., Recorder], tmp_path: Path
) -> None:
    joints = robot.publisher(JointState, 'noise')
    topics = ('--topics', 'noise:sensor_msgs/JointState')
    recorder = record(tmp_path / 'walk', *topics, limit=5 << 20)
    wait_for(joints.get_subscription_count)
    noise = np.random.default_rng(0)
    deadline = time.monotonic() + LONG
    while recorder.process.poll() is None:
        assert time.monotonic() < deadline
        joints.publish(JointState(position=noise.normal(size=4000).tolist()))
        time.sleep(0.002)
    code, _, err = recorder.result()
    assert code == 2
    stopped = re.search(r'may not grow further.*The (\d+) messages in the bag are readable', err)
    assert stopped, err
    recording = Recording.open(tmp_path / 'walk')
    assert recording.topics[f'{robot.namespace}/noise'].count == int(stopped[1]) > 20


_FAILS_AT_THE_THIRD = """
from power_recordings.writing.writer import BagWriter
write, times = BagWriter.write, []
def failing(*arguments):
    times.append(1)
    if len(times) == 3:
        raise LookupError('no such channel')
    write(*arguments)
BagWriter.write = failing
"""
_FULL = """
from power_recordings.writing.metadata import CardFile
from wattwalk_core.files import RecordingError
def full(*_):
    if len(times) == 3: raise RecordingError('no room for the card')
CardFile.add_drives = full
"""


@pytest.mark.parametrize('card', ['', _FULL], ids=['', 'and the card cannot be written'])
def test_a_writer_that_fails_ends_the_recording_with_its_own_cause(
    robot: Robot, record: Callable[..., Recorder], tmp_path: Path, card: str
) -> None:
    supply = robot.publisher(DriveSupply, 'drive_supply')
    recorder = record(tmp_path / 'walk', before=_FAILS_AT_THE_THIRD + card)
    wait_for(supply.get_subscription_count)
    robot.stream(supply, lambda: recorder.process.poll() is not None)
    code, out, err = recorder.result()
    assert code == 1
    assert 'LookupError: no such channel' in err
    assert 'walk: 2 messages written, ' in err
    assert 'disk' not in out + err
    recording = Recording.open(tmp_path / 'walk')
    assert recording.topics[f'{robot.namespace}/drive_supply'].count == 2
    assert recording.card.drives == (() if card else ('LF_HAA', 'LF_KFE'))


def test_nothing_on_any_topic_is_said(record: Callable[..., Recorder], tmp_path: Path) -> None:
    recorder = record(tmp_path / 'walk', '--topics', 'supply', '--duration', '0.5')
    code, out, _ = recorder.result()
    assert code == 1
    assert 'no message came on any topic' in out


def test_a_duration_that_waits_counts_from_the_first_sample_of_power_on(
    robot: Robot, record: Callable[..., Recorder], tmp_path: Path
) -> None:
    supply = robot.publisher(DriveSupply, 'drive_supply')
    recorder = record(tmp_path / 'walk', '--wait', '--duration', '0.5')
    wait_for(supply.get_subscription_count)
    time.sleep(2.0)
    assert recorder.process.poll() is None
    robot.stream(supply, lambda: recorder.process.poll() is not None)
    assert recorder.result()[0] == 0
    stamps = Recording.open(tmp_path / 'walk').drive_supply().stamp_ns
    assert (stamps[-1] - stamps[0]) / 1e9 > 0.4


def test_an_end_before_the_awaited_power_is_an_error(
    robot: Robot, record: Callable[..., Recorder], tmp_path: Path
) -> None:
    joints = robot.publisher(JointState, 'joint_states')
    recorder = record(tmp_path / 'walk', '--wait')
    wait_for(joints.get_subscription_count)
    joints.publish(JointState())
    robot.wait_for_diagnostics(f'{robot.namespace}/joint_states messages', '1')
    code, out, err = recorder.end()
    assert code == 1
    assert 'no sample came on' in out + err


@pytest.mark.parametrize(
    ('arguments', 'error'),
    [
        (['--topics', 'camera'], "unknown topic 'camera': give its type"),
        (
            ['--topics', 'camera:sensor_msgs/Nonsense'],
            "unknown message type 'sensor_msgs/Nonsense'",
        ),
        (['--topics', 'fluid:actuator_msgs/Nothing'], 'unknown message type'),
        (['--card', 'robot'], "--card 'robot': expected key=value"),
        (['--card', 'seed=soon'], "seed: expected a whole number, there is 'soon'"),
        (['--duration', '-3'], '--duration is -3 s'),
    ],
)
def test_bad_arguments_end_with_one_line_and_leave_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], error: str
) -> None:
    assert main(['-o', str(tmp_path / 'walk'), *arguments]) == 2
    stderr = capsys.readouterr().err
    assert error in stderr
    assert stderr.count('\n') == 1
    assert not (tmp_path / 'walk').exists()


def test_an_existing_folder_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['-o', str(tmp_path)]) == 2
    assert 'exists already: choose another name' in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_disk_without_room_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(shutil, 'disk_usage', lambda path: usage._replace(free=20_000_000))
    with pytest.raises(InputError, match=r'only 20 MB are free for .*walk'):
        check_room(tmp_path / 'not' / 'yet' / 'walk')


def test_topics_are_taken_by_name_or_with_their_type() -> None:
    assert set(topics_of(None)) == {
        *('drive_supply', 'joint_states', 'joint_commands', 'supply', 'power_estimate', 'imu'),
        *('odom', 'cmd_vel', 'foot_force', 'diagnostics'),
    }
    assert topics_of(['/dog/imu', 'note:std_msgs/String']) == {
        '/dog/imu': 'sensor_msgs/msg/Imu',
        'note': 'std_msgs/msg/String',
    }


def test_the_card_is_made_of_keys_and_values() -> None:
    card = card_of(['drives=LF_HAA, LF_KFE', 'notes=a=b', 'seed=-4', 'created=today'])
    assert card.drives == ('LF_HAA', 'LF_KFE')
    assert (card.notes, card.seed, card.created) == ('a=b', -4, 'today')
