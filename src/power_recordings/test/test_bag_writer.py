import errno
import os
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory
from power_recordings.messages import cdr
from power_recordings.writing.writer import BagWriter, MessageBlock
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader
from wattwalk_core.errors import InputError
from wattwalk_core.files import RecordingError

START = 1_700_000_000_000_000_000
NAMES = ('LF_HAA', 'LF_HFE', 'LF_KFE')


def supply_messages(count: int) -> list[bytes]:
    stamps = START + np.arange(count) * 1_000_000
    wave = np.sin(np.arange(count)[:, None] / 50 + np.arange(3))
    return cdr.in_a_list(
        *cdr.drive_supply_blocks(stamps, 0, np.arange(count), NAMES, 48 + wave, 2 * wave)
    )


def write_bag(path: Path, count: int = 2000, **options: object) -> BagWriter:
    with BagWriter(path, **options) as bag:  # type: ignore[arg-type]
        supply = bag.add_topic('drive_supply', cdr.DRIVE_SUPPLY)
        joints = bag.add_topic('/joint_states', cdr.JOINT_STATE, 'best_effort')
        stamps = START + np.arange(count) * 1_000_000
        states = cdr.in_a_list(cdr.joint_state_block(stamps, NAMES, np.ones((count, 3))))
        for i, (message, state) in enumerate(zip(supply_messages(count), states, strict=True)):
            bag.write(supply, START + i * 1_000_000, message)
            if i % 2 == 0:
                bag.write(joints, START + i * 1_000_000, state)
    return bag


def messages_of_a_cut_file(path: Path) -> int:
    with path.open('rb') as file:
        count = 0
        try:
            for record in StreamReader(file).records:
                count += type(record).__name__ == 'Message'
        except EndOfFile:
            pass
    return count


def test_other_readers_read_the_bag(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / 'walk')
    for reader in (Reader(tmp_path / 'walk'), AnyReader([tmp_path / 'walk'])):
        with reader:
            assert {c.topic: c.msgcount for c in reader.connections} == {
                '/drive_supply': 2000,
                '/joint_states': 1000,
            }
            assert sum(1 for _ in reader.messages()) == 3000
    with bag.file.open('rb') as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        decoded = [m for *_, m in reader.iter_decoded_messages(topics=['/drive_supply'])]
    assert [m.sequence for m in decoded] == list(range(2000))
    assert decoded[7].voltage[1] == pytest.approx(48 + np.sin(7 / 50 + 1))
    assert decoded[7].header.stamp.nanosec == 7_000_000
    with AnyReader([tmp_path / 'walk']) as reader:
        connection, time, raw = next(reader.messages())
        message = reader.deserialize(raw, connection.msgtype)
        assert list(message.name) == list(NAMES)
        assert time == START


def test_metadata_has_the_form_of_rosbag2_version_9(tmp_path: Path) -> None:
    write_bag(tmp_path / 'walk')
    content = yaml.safe_load((tmp_path / 'walk' / 'metadata.yaml').read_text())
    information = content['rosbag2_bagfile_information']
    assert information['version'] == 9
    assert information['storage_identifier'] == 'mcap'
    assert information['relative_file_paths'] == ['walk_0.mcap']
    assert information['duration'] == {'nanoseconds': 1999 * 1_000_000}
    assert information['starting_time'] == {'nanoseconds_since_epoch': START}
    assert information['message_count'] == 3000
    supply, joints = information['topics_with_message_count']
    assert supply['topic_metadata']['type'] == 'drive_power_msgs/msg/DriveSupply'
    assert joints['message_count'] == 1000
    profile = joints['topic_metadata']['offered_qos_profiles'][0]
    assert (profile['reliability'], profile['depth']) == ('best_effort', 1000)
    # The hash that ROS 2 Jazzy itself advertises for sensor_msgs/msg/JointState.
    assert joints['topic_metadata']['type_description_hash'] == (
        'RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e'
    )


def test_equal_calls_give_equal_bytes(tmp_path: Path) -> None:
    first = write_bag(tmp_path / 'a' / 'walk')
    second = write_bag(tmp_path / 'b' / 'walk')
    assert first.file.read_bytes() == second.file.read_bytes()
    assert (first.path / 'metadata.yaml').read_bytes() == (
        second.path / 'metadata.yaml'
    ).read_bytes()


@pytest.mark.parametrize('period', [0.5, 10.0])
def test_blocks_give_the_same_file_as_their_messages_one_by_one(
    tmp_path: Path, period: float
) -> None:
    rng = np.random.default_rng(1)
    with (
        BagWriter(tmp_path / 'a' / 'walk', flush_period=period) as blocks,
        BagWriter(tmp_path / 'b' / 'walk', flush_period=period) as single,
    ):
        for bag in (blocks, single):
            bag.add_topic('joint_states', cdr.JOINT_STATE)
            bag.add_topic('drive_supply', cdr.DRIVE_SUPPLY)
        begin = START
        for count in (1, 40, 9000, 3000):
            stamps = begin + np.cumsum(rng.choice([0, 10**5, 10**6], count))
            begin = int(stamps[-1]) - 700_000_000 * (count == 40)
            numbers = rng.normal(size=(count, 3))
            states = cdr.joint_state_block(stamps, NAMES, numbers, numbers)
            supply, *rest = cdr.drive_supply_blocks(
                stamps, 0, stamps.astype(np.uint64), NAMES, numbers, numbers, None, None, 7
            )
            parts = [MessageBlock(1, stamps, states)]
            times = stamps[::7]
            parts.append(MessageBlock(2, times[: len(supply)], supply))
            parts += [MessageBlock(2, times[-1:], part) for part in rest]
            blocks.write_blocks(parts)
            rows = [
                (t, p.topic, m) for p in parts for t, m in zip(p.times, p.messages, strict=True)
            ]
            for time, topic, message in sorted(rows, key=lambda row: row[0]):
                single.write(topic, time, message.tobytes())
    assert blocks.counts == single.counts
    assert blocks.file.read_bytes() == single.file.read_bytes()


def test_what_is_older_than_the_flush_period_is_in_the_file_before_close(tmp_path: Path) -> None:
    bag = BagWriter(tmp_path / 'walk', flush_period=0.5)
    topic = bag.add_topic('drive_supply', cdr.DRIVE_SUPPLY)
    for i, message in enumerate(supply_messages(2250)):
        bag.write(topic, START + i * 1_000_000, message)
    assert messages_of_a_cut_file(bag.file) == 4 * 501
    bag.flush()
    assert messages_of_a_cut_file(bag.file) == 2250
    bag.close()


def test_a_folder_that_exists_is_left_alone(tmp_path: Path) -> None:
    write_bag(tmp_path / 'walk', 10)
    before = (tmp_path / 'walk' / 'walk_0.mcap').read_bytes()
    with pytest.raises(InputError, match='walk exists already'):
        BagWriter(tmp_path / 'walk')
    assert (tmp_path / 'walk' / 'walk_0.mcap').read_bytes() == before
    (tmp_path / 'thesis').mkdir()
    (tmp_path / 'thesis' / 'chapter.tex').write_text('years of work')
    with pytest.raises(InputError, match='not a recording'):
        BagWriter(tmp_path / 'thesis', overwrite=True)
    assert (tmp_path / 'thesis' / 'chapter.tex').exists()
    write_bag(tmp_path / 'walk', 20, overwrite=True)
    assert messages_of_a_cut_file(tmp_path / 'walk' / 'walk_0.mcap') == 30


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / 'file').write_text('')
    with pytest.raises(RecordingError, match=r'file/walk.*choose another folder'):
        BagWriter(tmp_path / 'file' / 'walk')


@pytest.mark.skipif(os.geteuid() == 0, reason='root may write everywhere')
def test_a_read_only_folder_is_named(tmp_path: Path) -> None:
    (tmp_path / 'locked').mkdir(mode=0o500)
    with pytest.raises(RecordingError, match='no permission'):
        BagWriter(tmp_path / 'locked' / 'walk')


class FullDisk:
    """os.write that fails while the reserve is held, or for good."""

    def __init__(self, bag: BagWriter, room: int, for_good: bool) -> None:
        self.bag, self.room, self.for_good = bag, room, for_good
        self.real = os.write

    def __call__(self, descriptor: int, data: bytes) -> int:
        if self.bag._output._reserve is None and not self.for_good:
            return self.real(descriptor, data)
        if not self.room:
            raise OSError(errno.ENOSPC, 'No space left on device')
        written = self.real(descriptor, data[: self.room])
        self.room -= written
        return written


def fill_the_disk(
    bag: BagWriter, disk: FullDisk, monkeypatch: pytest.MonkeyPatch
) -> tuple[int, str]:
    topic = bag.add_topic('drive_supply', cdr.DRIVE_SUPPLY)
    monkeypatch.setattr(os, 'write', disk)
    for i, message in enumerate(supply_messages(5000)):
        try:
            bag.write(topic, START + i * 1_000_000, message)
        except RecordingError as error:
            monkeypatch.undo()
            return i + 1, str(error)
    raise AssertionError('the disk never filled')


def test_a_full_disk_closes_the_bag_with_all_messages_in_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = BagWriter(tmp_path / 'walk')
    given, error = fill_the_disk(bag, FullDisk(bag, 30_000, for_good=False), monkeypatch)
    with Reader(tmp_path / 'walk') as reader:
        assert reader.message_count == given
        assert sum(1 for _ in reader.messages()) == given
    assert 'the disk is full' in error
    assert f'holds all {given} messages' in error
    with pytest.raises(RecordingError, match='closed'):
        bag.flush()
    bag.close()


def test_a_disk_without_any_room_left_keeps_whole_chunks_and_counts_the_rest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = BagWriter(tmp_path / 'walk')
    given, error = fill_the_disk(bag, FullDisk(bag, 30_000, for_good=True), monkeypatch)
    kept = messages_of_a_cut_file(bag.file)
    assert kept > 0
    assert f'{kept} messages in the bag are readable' in error
    assert f'{given - kept} messages are lost' in error
    assert not (tmp_path / 'walk' / 'metadata.yaml').exists()


LIMITED = """
import sys
from pathlib import Path
from power_recordings.messages import cdr
from power_recordings.writing.writer import BagWriter
import numpy as np
bag = BagWriter(Path(sys.argv[1]))
topic = bag.add_topic('joint_states', cdr.JOINT_STATE)
noise = np.random.default_rng(0).normal(size=(40000, 12))
stamps = np.arange(40000) * 1_000_000
block = cdr.joint_state_block(stamps, 'abcdefghijkl', noise)
for stamp, message in zip(stamps, cdr.in_a_list(block)):
    bag.write(topic, stamp, message)
"""


def test_a_real_file_size_limit_leaves_a_readable_file(tmp_path: Path) -> None:
    limit = 4_500_000
    result = subprocess.run(
        [sys.executable, '-c', LIMITED, str(tmp_path / 'walk')],
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )
    assert 'RecordingError' in result.stderr
    assert 'may not grow further' in result.stderr
    kept = messages_of_a_cut_file(tmp_path / 'walk' / 'walk_0.mcap')
    assert f'The {kept} messages in the bag are readable' in result.stderr
    assert kept > 20_000


def test_wrong_calls_are_answered_clearly(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r'flush_period is 0'):
        BagWriter(tmp_path / 'walk', flush_period=0)
    with BagWriter(tmp_path / 'walk') as bag:
        bag.add_topic('supply', cdr.BATTERY_STATE)
        with pytest.raises(InputError, match=r"'/supply' is in the bag already"):
            bag.add_topic('/supply', cdr.BATTERY_STATE)
        with pytest.raises(InputError, match=r'unknown message type .sensor_msgs/msg/Nonsense'):
            bag.add_topic('x', 'sensor_msgs/msg/Nonsense')
        with pytest.raises(InputError, match="'loud'"):
            bag.add_topic('x', cdr.BATTERY_STATE, 'loud')
        with pytest.raises(InputError, match='no topic 7'):
            bag.write(7, START, b'')
    with pytest.raises(RecordingError, match='closed'):
        bag.write(1, START, b'')


def test_a_bag_without_messages_is_still_a_bag(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'walk') as bag:
        bag.add_topic('supply', cdr.BATTERY_STATE)
    with Reader(tmp_path / 'walk') as reader:
        assert reader.message_count == 0
        assert [c.topic for c in reader.connections] == ['/supply']
