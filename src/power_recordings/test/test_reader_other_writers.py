"""Recordings of other writers: rosbags, split bags, compressed and unchunked files."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from power_recordings.messages import cdr
from power_recordings.reading.reader import Recording
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.rosbag2.enums import CompressionFormat, CompressionMode
from wattwalk_core.errors import InputError

START = 1_700_000_000_000_000_000
Make = Callable[..., Any]


def write_with_rosbags(path: Path, sketch: Any, plugin: StoragePlugin, packed: bool) -> None:
    store = cdr.typestore()
    writer = RosbagsWriter(path, version=9, storage_plugin=plugin)
    if packed:
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with writer:
        for name, (type_name, times, messages) in sketch.all_topics().items():
            connection = writer.add_connection(name, type_name, typestore=store)
            for time, message in zip(times, messages, strict=True):
                writer.write(connection, int(time), message)


@pytest.mark.parametrize(
    ('plugin', 'packed'),
    [(StoragePlugin.MCAP, False), (StoragePlugin.MCAP, True), (StoragePlugin.SQLITE3, False)],
)
def test_bags_of_other_writers_are_read(
    walk: Make, tmp_path: Path, plugin: StoragePlugin, packed: bool
) -> None:
    sketch = walk(5.0)
    sketch.current[:] = np.random.default_rng(1).normal(size=sketch.current.shape)
    write_with_rosbags(tmp_path / 'walk', sketch, plugin, packed)
    recording = Recording.open(tmp_path / 'walk')
    assert recording.problems == ()
    np.testing.assert_array_equal(
        recording.drive_supply().current, sketch.current.astype(np.float32)
    )
    assert len(recording.joint_states()) == 2000


@pytest.mark.parametrize('chunked', [True, False])
def test_files_without_chunks_or_in_lz4_are_read(
    walk: Make, tmp_path: Path, chunked: bool
) -> None:
    sketch = walk(1.0)
    with (tmp_path / 'walk.mcap').open('wb') as file:
        writer = McapWriter(file, use_chunking=chunked, compression=CompressionType.LZ4)
        writer.start('ros2')
        for name, (type_name, times, messages) in sketch.all_topics().items():
            schema = writer.register_schema(
                type_name, 'ros2msg', cdr.definition(type_name).encode()
            )
            topic = writer.register_channel(name, 'cdr', schema)
            for time, message in zip(times, messages, strict=True):
                writer.add_message(topic, int(time), message, int(time))
        writer.finish()
    recording = Recording.open(tmp_path / 'walk.mcap')
    assert (recording.drive_supply().stamp_ns == sketch.supply_stamps).all()
    assert len(recording.joint_commands()) == 50


def test_a_bag_split_into_files_is_read_as_one(walk: Make, tmp_path: Path) -> None:
    sketch = walk(1.0)
    first = sketch.write(tmp_path / 'walk')
    later = walk(1.0)
    later.supply_stamps += 1_000_000_000
    later.joint_stamps += 1_000_000_000
    later.command_stamps += 1_000_000_000
    second = later.write(tmp_path / 'more')
    shutil.copy(second / 'more_0.mcap', first / 'walk_1.mcap')
    content = yaml.safe_load((first / 'metadata.yaml').read_text())
    information = content['rosbag2_bagfile_information']
    information['relative_file_paths'].append('walk_1.mcap')
    information['message_count'] *= 2
    (first / 'metadata.yaml').write_text(yaml.safe_dump(content))
    recording = Recording.open(first)
    assert recording.problems == ()
    assert len(recording.drive_supply()) == 2000
    assert recording.duration == pytest.approx(1.999)
    (first / 'walk_1.mcap').unlink()
    assert Recording.open(first).problems[0] == 'walk_1.mcap is missing'


def test_bags_compressed_as_a_whole_say_how_to_unpack_them(walk: Make, tmp_path: Path) -> None:
    path = walk(0.1).write(tmp_path / 'walk')
    text = (path / 'metadata.yaml').read_text()
    (path / 'metadata.yaml').write_text(
        text.replace("compression_mode: ''", 'compression_mode: FILE')
    )
    with pytest.raises(InputError, match='compressed by file: run `ros2 bag convert`'):
        Recording.open(path)
