import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import Writer as McapWriter
from power_recordings.card import Card
from power_recordings.messages import cdr
from power_recordings.reading.reader import Recording
from power_recordings.writing.writer import BagWriter
from wattwalk_core.errors import InputError

START = 1_700_000_000_000_000_000
Make = Callable[..., Any]


def test_everything_comes_back_as_it_was_written(walk: Make, tmp_path: Path) -> None:
    sketch = walk(1.0)
    random = np.random.default_rng(0)
    for name in ('voltage', 'current', 'position', 'velocity', 'effort', 'command'):
        getattr(sketch, name)[:] = random.normal(size=getattr(sketch, name).shape)
    sketch.status[5, 1] = 4
    Card(robot='anymal_c', unit='B').save(sketch.write(tmp_path / 'walk'))
    recording = Recording.open(tmp_path / 'walk')
    drives, joints = recording.drive_supply(), recording.joint_states()
    assert recording.problems == ()
    assert recording.card.unit == 'B'
    assert recording.duration == pytest.approx(0.999)
    assert recording.topics['/drive_supply'].count == 1000
    assert drives.names == joints.names == ('LF_HAA', 'LF_HFE', 'LF_KFE')
    assert (drives.stamp_ns == sketch.supply_stamps).all()
    assert (drives.sequence == np.arange(1000)).all()
    assert (drives.device_time == sketch.supply_stamps - START).all()
    np.testing.assert_array_equal(drives.voltage, sketch.voltage.astype(np.float32))
    np.testing.assert_array_equal(drives.status, sketch.status)
    np.testing.assert_array_equal(joints.effort, sketch.effort.astype(np.float32))
    np.testing.assert_allclose(drives.power, sketch.voltage * sketch.current, rtol=1e-5)
    commands = recording.joint_commands()
    np.testing.assert_array_equal(commands.position, sketch.command.astype(np.float32))
    assert np.isnan(commands.velocity).all()


def test_messages_of_several_samples_become_samples(tmp_path: Path) -> None:
    stamps = START + np.arange(10) * 1_000_000
    ticks = np.arange(10, dtype=np.uint64) * 1_000_200 + np.uint64(2**63)
    values = np.arange(20.0).reshape(10, 2)
    block = cdr.in_a_list(
        *cdr.drive_supply_blocks(
            stamps, 70, ticks, 'ab', values, -values, [30, 31], None, samples_per_message=4
        )
    )
    with BagWriter(tmp_path / 'walk') as bag:
        topic = bag.add_topic('drive_supply', cdr.DRIVE_SUPPLY)
        for i, message in enumerate(block):
            bag.write(topic, START + i, message)
    drives = Recording.open(tmp_path / 'walk').drive_supply()
    assert drives.sequence.tolist() == list(range(70, 80))
    assert drives.voltage.tolist() == values.tolist()
    assert (drives.device_time == ticks).all()
    # Within a message the device's clock says when: 1.0002 ms from sample to sample.
    assert np.diff(drives.stamp_ns).tolist() == [1_000_200] * 3 + [999_400] + [1_000_200] * 3 + [
        999_400
    ] + [1_000_200]
    assert drives.temperature[9].tolist() == [30, 31]


def test_names_in_another_order_from_message_to_message_are_put_in_order(tmp_path: Path) -> None:
    orders = ('abc', 'cab', 'abc', 'ba', 'abcd')
    with BagWriter(tmp_path / 'walk') as bag:
        topic = bag.add_topic('joint_states', cdr.JOINT_STATE)
        for i, order in enumerate(orders):
            values = [{'a': 1.0, 'b': 2.0, 'c': 3.0, 'd': 4.0}[name] + 10 * i for name in order]
            message = cdr.in_a_list(cdr.joint_state_block(np.array([START + i]), order, [values]))[
                0
            ]
            bag.write(topic, START + i, message)
    joints = Recording.open(tmp_path / 'walk').joint_states()
    assert joints.names == ('a', 'b', 'c', 'd')
    np.testing.assert_array_equal(
        joints.position,
        [
            [1, 2, 3, np.nan],
            [11, 12, 13, np.nan],
            [21, 22, 23, np.nan],
            [31, 32, np.nan, np.nan],
            [41, 42, 43, 44],
        ],
    )


def test_the_other_topics_become_samples(walk: Make, tmp_path: Path) -> None:
    sketch = walk(0.1)
    times = START + np.arange(3) * 10_000_000
    unit, rate = np.eye(4)[:3], np.arange(9.0).reshape(3, 3)
    estimate = cdr.serialize(
        cdr.POWER_ESTIMATE,
        cdr.message(cdr.POWER_ESTIMATE, model='ppn', name=['a'], power=[3.5], total=3.5, status=1),
    )
    sketch.topics = {
        '/supply': (
            cdr.BATTERY_STATE,
            times,
            cdr.in_a_list(cdr.battery_block(times, [48] * 3, [-2, -3, 4])),
        ),
        '/imu': (cdr.IMU, times, cdr.in_a_list(cdr.imu_block(times, unit, rate, -rate))),
        '/odom': (
            cdr.ODOMETRY,
            times,
            cdr.in_a_list(cdr.odometry_block(times, rate, unit, -rate, 2 * rate)),
        ),
        '/cmd_vel': (cdr.TWIST_STAMPED, times, cdr.in_a_list(cdr.twist_block(times, rate))),
        '/foot_force': (
            cdr.JOINT_STATE,
            times,
            cdr.in_a_list(cdr.joint_state_block(times, 'xy', effort=rate[:, :2])),
        ),
        '/power_estimate': (cdr.POWER_ESTIMATE, times[:1], [estimate]),
    }
    recording = Recording.open(sketch.write(tmp_path / 'walk'))
    # A battery that is drawn from has negative current, the opposite of a drive that draws.
    assert recording.supply().power.tolist() == [96, 144, -192]
    assert recording.imu().orientation.tolist() == unit.tolist()
    assert recording.imu().linear_acceleration.tolist() == (-rate).tolist()
    assert recording.odom().linear_velocity.tolist() == (-rate).tolist()
    assert recording.odom().position.tolist() == rate.tolist()
    assert recording.cmd_vel().velocity.tolist() == rate.tolist()
    assert recording.foot_force().force.tolist() == rate[:, :2].tolist()
    estimates = recording.power_estimate()
    assert (estimates.names, estimates.model) == (('a',), ('ppn',))
    assert (estimates.power.tolist(), estimates.status.tolist()) == ([[3.5]], [1])


def test_duplicates_and_stamps_that_run_backwards_are_cut_out_and_reported(
    walk: Make, tmp_path: Path
) -> None:
    sketch = walk(1.0)
    sketch.late = lambda times: np.arange(len(times)) * 1000
    sketch.supply_stamps[100] = sketch.supply_stamps[99]
    sketch.joint_stamps[200:] -= 51_000_000
    sketch.command_stamps[10] += 3_600_000_000_000
    recording = Recording.open(sketch.write(tmp_path / 'walk'))
    assert recording.problems == (
        '/drive_supply: 1 samples with the stamp of another left out',
        '/joint_states: 20 samples whose stamps run backwards cut out, the first at '
        f'{(START + 449_000_000) / 1e9:.3f} s',
        '/joint_commands: 1 samples whose stamps run backwards cut out, the first at '
        f'{(START + 3_600_200_000_000) / 1e9:.3f} s',
    )
    assert len(recording.drive_supply()) == 999
    joints = recording.joint_states()
    assert len(joints) == 380
    assert (np.diff(joints.stamp_ns) > 0).all()
    # After the cut the clock stands where it stood, but time has passed: nothing may bridge it.
    assert recording.breaks('joint_states').tolist() == [START + 499_000_000]
    assert len(recording.joint_commands()) == 49


def cut(path: Path, source: Path, keep: int) -> Path:
    shutil.copytree(source, path)
    file = next(path.glob('*.mcap'))
    file.write_bytes(file.read_bytes()[:keep])
    (path / 'metadata.yaml').unlink()
    return path


def test_a_recording_without_metadata_is_read_and_says_so(walk: Make, tmp_path: Path) -> None:
    path = walk(1.0).write(tmp_path / 'walk')
    (path / 'metadata.yaml').unlink()
    recording = Recording.open(path)
    assert recording.problems == ('no metadata.yaml: the recorder was killed',)
    assert len(recording.drive_supply()) == 1000
    (path / 'metadata.yaml').write_text('rosbag2_bagfile_information: [')
    recording = Recording.open(path)
    assert recording.problems == ('metadata.yaml is damaged: not used',)
    assert len(recording.drive_supply()) == 1000


def test_a_file_whose_name_ends_in_a_raised_digit_disturbs_no_bag(
    walk: Make, tmp_path: Path
) -> None:
    path = walk(1.0).write(tmp_path / 'walk')
    (path / 'walk_².mcap').touch()
    assert len(Recording.open(path).drive_supply()) == 1000


def test_a_recording_cut_off_anywhere_is_read_up_to_its_last_whole_chunk(
    walk: Make, tmp_path: Path
) -> None:
    source = walk(3.0).write(tmp_path / 'walk')
    size = (source / 'walk_0.mcap').stat().st_size
    found = []
    for i, share in enumerate((0.4, 0.55, 0.7, 0.85, 0.99)):
        recording = Recording.open(cut(tmp_path / f'cut{i}', source, int(size * share)))
        supply = recording.drive_supply()
        assert any('was not closed' in problem for problem in recording.problems)
        assert (supply.sequence == np.arange(len(supply))).all()
        found.append(len(supply))
    assert found == sorted(found)
    assert 500 <= found[0] < found[-1] <= 3000


def test_missing_messages_are_counted(walk: Make, tmp_path: Path) -> None:
    source = walk(2.0).write(tmp_path / 'walk')
    path = tmp_path / 'short' / 'walk'
    cut(path, source, (source / 'walk_0.mcap').stat().st_size // 2)
    shutil.copy(source / 'metadata.yaml', path)
    recording = Recording.open(path)
    whole = 2000 + 800 + 100
    there = sum(topic.count for topic in recording.topics.values())
    assert f'{whole - there} of {whole} messages are missing' in recording.problems


def test_a_chunk_with_a_flipped_bit_is_left_out(walk: Make, tmp_path: Path) -> None:
    path = walk(3.0).write(tmp_path / 'walk')
    file = path / 'walk_0.mcap'
    data = bytearray(file.read_bytes())
    data[len(data) // 3] ^= 0x10
    file.write_bytes(data)
    recording = Recording.open(path)
    assert any('damaged chunk' in problem for problem in recording.problems)
    assert any('messages are missing' in problem for problem in recording.problems)
    assert 2400 <= len(recording.drive_supply()) <= 2600


@pytest.mark.parametrize(
    ('content', 'error'),
    [
        (b'', r'walk_0\.mcap is empty'),
        (b'\x89MCAP0\r', r'holds no messages'),
        (b'\x89MCAP0\r\n', r'holds no messages.*was not closed'),
        (b'SQLite format 3\0' * 100, r"is not an MCAP file: it begins with b'SQLite f'"),
    ],
)
def test_files_with_nothing_to_read_are_refused(
    tmp_path: Path, content: bytes, error: str
) -> None:
    (tmp_path / 'walk').mkdir()
    (tmp_path / 'walk' / 'walk_0.mcap').write_bytes(content)
    with pytest.raises(InputError, match=error):
        Recording.open(tmp_path / 'walk')


def test_what_is_no_recording_is_refused(walk: Make, tmp_path: Path) -> None:
    with pytest.raises(InputError, match='there is no recording'):
        Recording.open(tmp_path / 'nowhere')
    (tmp_path / 'folder').mkdir()
    with pytest.raises(InputError, match=r'neither metadata\.yaml nor \*\.mcap'):
        Recording.open(tmp_path / 'folder')
    (tmp_path / 'notes.txt').write_text('hello')
    with pytest.raises(InputError, match=r'expected a bag folder or an \.mcap file'):
        Recording.open(tmp_path / 'notes.txt')
    path = walk(0.1).write(tmp_path / 'walk')
    (path / 'walk_0.mcap').unlink()
    with pytest.raises(InputError, match=r'lacks its data: metadata.yaml lists walk_0\.mcap'):
        Recording.open(path)


def test_a_bag_of_other_topics_is_refused_with_what_is_there(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'camera') as bag:
        topic = bag.add_topic('image', 'sensor_msgs/msg/Image')
        image = cdr.message('sensor_msgs/msg/Image', width=1, height=1, data=[7])
        bag.write(topic, START, cdr.serialize('sensor_msgs/msg/Image', image))
    recording = Recording.open(tmp_path / 'camera')
    with pytest.raises(InputError, match="no messages on topic 'drive_supply'; there are: /image"):
        recording.drive_supply()


def test_a_topic_of_another_type_is_refused(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'walk') as bag:
        topic = bag.add_topic('joint_states', cdr.BATTERY_STATE)
        bag.write(topic, START, cdr.in_a_list(cdr.battery_block(np.array([START]), [1], [1]))[0])
    with pytest.raises(InputError, match=r'/joint_states is a sensor_msgs/msg/BatteryState'):
        Recording.open(tmp_path / 'walk').joint_states()


def test_topics_in_a_namespace_are_found_unless_two_robots_are_there(
    walk: Make, tmp_path: Path
) -> None:
    sketch = walk(0.1)
    topics = sketch.all_topics()
    sketch.left_out = tuple(topics)
    sketch.topics = {f'/dog{name}': topic for name, topic in topics.items()}
    sketch.left_out = tuple(topics)
    assert len(Recording.open(sketch.write(tmp_path / 'one')).joint_states()) == 40
    sketch.left_out = ()
    with pytest.raises(InputError, match='record one robot at a time'):
        Recording.open(sketch.write(tmp_path / 'two')).joint_states()


def test_another_definition_of_a_message_is_refused(tmp_path: Path) -> None:
    text = 'std_msgs/Header header\nstring[] name\nfloat32[] volts\n'
    with (tmp_path / 'walk.mcap').open('wb') as file:
        writer = McapWriter(file)
        writer.start('ros2')
        schema = writer.register_schema(cdr.DRIVE_SUPPLY, 'ros2msg', text.encode())
        topic = writer.register_channel('/drive_supply', 'cdr', schema)
        writer.add_message(topic, START, b'\0\1\0\0' + bytes(40), START)
        writer.finish()
    with pytest.raises(InputError, match=r'another definition of drive_power_msgs.*volts'):
        Recording.open(tmp_path / 'walk.mcap').drive_supply()


def test_damaged_messages_are_counted_and_left_out(tmp_path: Path) -> None:
    good = cdr.in_a_list(cdr.joint_state_block(START + np.arange(3), 'ab', np.ones((3, 2))))
    with BagWriter(tmp_path / 'walk') as bag:
        topic = bag.add_topic('joint_states', cdr.JOINT_STATE)
        for i, message in enumerate([good[0], good[1][:-20], b'', b'\0\3\0\0abcd', good[2]]):
            bag.write(topic, START + i, message)
    recording = Recording.open(tmp_path / 'walk')
    assert recording.problems == ('/joint_states: 3 damaged messages left out',)
    assert recording.joint_states().stamp_ns.tolist() == [START, START + 2]


def test_wrong_array_lengths_are_named(tmp_path: Path) -> None:
    message = cdr.message(cdr.JOINT_STATE, name=['a', 'b', 'c'], position=[1, 2])
    with BagWriter(tmp_path / 'walk') as bag:
        topic = bag.add_topic('joint_states', cdr.JOINT_STATE)
        bag.write(topic, START, cdr.serialize(cdr.JOINT_STATE, message))
    with pytest.raises(InputError, match='joint_states: position has 2 values for 3 names'):
        Recording.open(tmp_path / 'walk').joint_states()


def test_names_that_never_settle_are_an_error(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'walk') as bag:
        topic = bag.add_topic('joint_states', cdr.JOINT_STATE)
        for i in range(300):
            message = cdr.in_a_list(
                cdr.joint_state_block(np.array([START + i]), [f'joint_{i:04}'], [[1.0]])
            )
            bag.write(topic, START + i, message[0])
    recording = Recording.open(tmp_path / 'walk')
    with pytest.raises(InputError, match='change in nearly every message'):
        recording.joint_states()


def test_a_topic_that_cannot_be_used_does_not_keep_others_from_being_read(
    walk: Make, tmp_path: Path
) -> None:
    sketch = walk(0.1)
    sketch.topics['/imu'] = (
        cdr.BATTERY_STATE,
        np.array([START]),
        cdr.in_a_list(cdr.battery_block(np.array([START]), [1], [1])),
    )
    recording = Recording.open(sketch.write(tmp_path / 'walk'))
    assert len(recording.joint_states()) == 40
    assert recording.has('imu')
    with pytest.raises(InputError, match='/imu is a sensor_msgs/msg/BatteryState'):
        recording.imu()


KILLED = """
import sys, time
from pathlib import Path
import numpy as np
from power_recordings.messages import cdr
from power_recordings.writing.writer import BagWriter

bag = BagWriter(Path(sys.argv[1]))
topic = bag.add_topic('drive_supply', cdr.DRIVE_SUPPLY)
stamps, values = np.arange(21_000) * 1_000_000, np.ones((21_000, 2))
messages = cdr.in_a_list(*cdr.drive_supply_blocks(stamps, 0, stamps, 'ab', values, values))
for i, message in enumerate(messages):
    bag.write(topic, i * 1_000_000, message)
    if i == 20_000:
        print(i, flush=True)
        time.sleep(60)
"""


def test_a_killed_writer_loses_less_than_a_second(tmp_path: Path) -> None:
    with subprocess.Popen(
        [sys.executable, '-c', KILLED, str(tmp_path / 'walk')], stdout=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b'20000\n'
        process.kill()
    recording = Recording.open(tmp_path / 'walk')
    assert 20_001 - len(recording.drive_supply()) <= 1000
    assert recording.problems[0] == 'no metadata.yaml: the recorder was killed'
