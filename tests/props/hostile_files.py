"""Small valid logs of every kind, and seeded damage to them."""

import json
import os
import socket
import struct
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from power_recordings.messages import cdr
from power_recordings.writing.writer import BagWriter

START = 1_700_000_000_000_000_000
RED = '\x1b[31mred\x1b[0m\x07'
LONG = 'n' * 100_000
NAMES = ('t', 'pos', 'vel', 'iq', 'v', 'i')
TABLE_MAP = """
format: import/1
time: {column: t, unit: s}
drives:
  KNEE:
    position: {from: pos, unit: rev}
    velocity: {from: vel, unit: rpm}
    torque: {from: iq, scale: 0.5, from_unit: A, at: motor}
    voltage: {from: v, unit: V}
    current: {from: i, unit: mA, positive: fed}
card: {robot: bench}
"""
BAG_MAP = """
format: import/1
time: {stamp: header}
drives:
  '*':
    position: {from: '/joint_states:position[*]', unit: rad}
    velocity: {from: '/joint_states:velocity[*]', unit: rad/s}
    torque: {from: '/joint_states:effort[*]', unit: N*m}
supply:
  voltage: {from: '/supply:voltage', unit: V}
  current: {from: '/supply:current', unit: A, positive: fed}
"""


def table(rows: int = 80) -> np.ndarray:
    t = np.arange(rows) / 100
    angle = np.sin(2 * np.pi * t)
    return np.stack([t, angle, 60 * angle, 2 + angle, 24 - angle, 1e3 * angle], axis=1)


def write_logs(folder: Path) -> dict[str, Path]:
    """Write a log of every kind; return them by kind."""
    import h5py
    import pyarrow as pa
    from openpyxl import Workbook
    from pyarrow import feather, parquet
    from scipy.io import savemat

    rows = table()
    named = {name: rows[:, i] for i, name in enumerate(NAMES)}
    found = {kind: folder / f'log.{kind}' for kind in TABLES}
    text = '\n'.join(','.join(f'{x:.6g}' for x in row) for row in rows)
    found['csv'].write_text(f'# a bench\n{",".join(NAMES)}\n{text}\n')
    found['tsv'].write_text(found['csv'].read_text().replace(',', '\t'))
    found['json'].write_text(json.dumps({k: v.tolist() for k, v in named.items()}))
    found['jsonl'].write_text(
        '\n'.join(json.dumps(dict(zip(NAMES, row, strict=True))) for row in rows.tolist())
    )
    savemat(found['mat'], {**named, 'more': {'a': [1, 'x', {'b': named['t']}]}})
    with h5py.File(found['h5'], 'w') as file:
        for name, values in named.items():
            file[name] = values
        file.create_dataset('packed', data=rows, chunks=(20, 6), compression='gzip')
    parquet.write_table(pa.table(named), found['parquet'])
    feather.write_feather(pa.table(named), found['feather'])
    book = Workbook()
    book.active.append(list(NAMES))
    for row in rows.tolist():
        book.active.append(row)
    book.save(found['xlsx'])
    found['bag'] = ros1_bag(folder / 'log.bag')
    found['mcap'] = mcap_bag(folder / 'walk') / 'walk_0.mcap'
    found['db3'] = sqlite_bag(folder / 'log.db3')
    return found


TABLES = ('csv', 'tsv', 'json', 'jsonl', 'mat', 'h5', 'parquet', 'feather', 'xlsx')


def mcap_bag(path: Path, count: int = 80) -> Path:
    stamps = START + np.arange(count) * 10_000_000
    angle = np.sin(np.arange(count) / 10)[:, None] + np.arange(2)
    with BagWriter(path) as bag:
        for name, kind, messages in (
            ('joint_states', cdr.JOINT_STATE, states(stamps, angle)),
            (
                'supply',
                cdr.BATTERY_STATE,
                cdr.in_a_list(cdr.battery_block(stamps, 24 + angle[:, 0], angle[:, 1])),
            ),
            (
                'drive_supply',
                cdr.DRIVE_SUPPLY,
                cdr.in_a_list(
                    *cdr.drive_supply_blocks(stamps, 0, stamps, ('HIP', 'KNEE'), 24 + angle, angle)
                ),
            ),
        ):
            topic = bag.add_topic(name, kind)
            for time, message in zip(stamps.tolist(), messages, strict=True):
                bag.write(topic, time, message)
    return path


def states(stamps: np.ndarray, angle: np.ndarray) -> list[bytes]:
    return cdr.in_a_list(cdr.joint_state_block(stamps, ('HIP', 'KNEE'), angle, angle, angle))


def ros1_bag(path: Path) -> Path:
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    header, joints = store.types['std_msgs/msg/Header'], store.types['sensor_msgs/msg/JointState']
    time, battery = (
        store.types['builtin_interfaces/msg/Time'],
        store.types['sensor_msgs/msg/BatteryState'],
    )
    empty = np.zeros(0, np.float32)
    writer = Writer(path)
    writer.set_compression(Writer.CompressionFormat.BZ2)
    with writer as bag:
        states = bag.add_connection('/joint_states', joints.__msgtype__, typestore=store)
        supply = bag.add_connection('/supply', battery.__msgtype__, typestore=store)
        for i in range(80):
            stamp = START + i * 10_000_000
            head = header(i, time(*divmod(stamp, 10**9)), '')
            angle = np.sin([i / 10, i / 10 + 1])
            state = joints(head, ['HIP', 'KNEE'], angle, angle, angle)
            bag.write(states, stamp, store.serialize_ros1(state, joints.__msgtype__))
            message = battery(
                head, 24.0, 0.0, -2.0, *[0.0] * 3, 0.0, 0, 0, 0, True, empty, empty, '', ''
            )
            bag.write(supply, stamp, store.serialize_ros1(message, battery.__msgtype__))
    return path


def sqlite_bag(path: Path) -> Path:
    import sqlite3

    stamps = START + np.arange(80) * 10_000_000
    angle = np.sin(np.arange(80) / 10)[:, None] + np.arange(2)
    with sqlite3.connect(path) as database:
        database.executescript(
            'CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,'
            ' serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);'
            'CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL,'
            ' timestamp INTEGER NOT NULL, data BLOB NOT NULL);'
            'CREATE INDEX timestamp_idx ON messages (timestamp ASC);'
        )
        topics = (
            ('/joint_states', cdr.JOINT_STATE, states(stamps, angle)),
            (
                '/supply',
                cdr.BATTERY_STATE,
                cdr.in_a_list(cdr.battery_block(stamps, angle[:, 0], angle[:, 1])),
            ),
        )
        for number, (name, kind, messages) in enumerate(topics, 1):
            database.execute(
                'INSERT INTO topics VALUES (?, ?, ?, "cdr", "")', (number, name, kind)
            )
            database.executemany(
                'INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)',
                [(number, int(t), m) for t, m in zip(stamps, messages, strict=True)],
            )
    database.close()
    return path


Damage = Callable[[np.random.Generator, bytes], bytes]


def cut(rng: np.random.Generator, data: bytes) -> bytes:
    return data[: int(rng.integers(len(data)))]


def flipped(rng: np.random.Generator, data: bytes) -> bytes:
    raw = np.frombuffer(data, np.uint8).copy()
    places = rng.integers(len(raw), size=int(rng.integers(1, 20)))
    raw[places] ^= rng.integers(1, 256, len(places)).astype(np.uint8)
    return raw.tobytes()


def extreme(rng: np.random.Generator, data: bytes) -> bytes:
    """Put numbers that are far too large, or too small by one, where lengths may be."""
    raw = bytearray(data)
    for _ in range(int(rng.integers(1, 4))):
        value = int(rng.choice([0, 1, 2**31 - 1, 2**32 - 1, 2**62, 2**63 - 1]))
        size = int(rng.choice([4, 8]))
        start = int(rng.integers(max(len(raw) - size, 1)))
        raw[start : start + size] = struct.pack('<Q', value)[:size]
    return bytes(raw)


def inserted(rng: np.random.Generator, data: bytes) -> bytes:
    start = int(rng.integers(len(data)))
    pieces = (rng.bytes(int(rng.integers(1, 300))), b'\0' * 200, b'\x1b[31m\x07\n', b'9' * 400)
    return data[:start] + pieces[int(rng.integers(len(pieces)))] + data[start:]


def repeated(rng: np.random.Generator, data: bytes) -> bytes:
    start, stop = sorted(rng.integers(len(data), size=2).tolist())
    return data[:stop] + data[start:]


def zeroed(rng: np.random.Generator, data: bytes) -> bytes:
    start, stop = sorted(rng.integers(len(data), size=2).tolist())
    return data[:start] + bytes(stop - start) + data[stop:]


DAMAGES: Sequence[Damage] = (cut, flipped, extreme, inserted, repeated, zeroed)


def damaged(data: bytes, seed: int) -> bytes:
    """Return the data with the damage that a seed stands for."""
    rng = np.random.default_rng(seed)
    return DAMAGES[seed % len(DAMAGES)](rng, data)


def special_paths(folder: Path, ending: str) -> Iterator[tuple[str, Path]]:
    """Things that are no regular files, under a name with an ending."""
    for name in ('folder', 'pipe', 'socket', 'zero', 'loop', 'dangling', 'empty'):
        path = folder / f'{name}{ending}'
        if name == 'folder':
            path.mkdir()
        elif name == 'pipe':
            os.mkfifo(path)
        elif name == 'socket':
            with socket.socket(socket.AF_UNIX) as server:
                server.bind(str(path))
        elif name == 'empty':
            path.touch()
        else:
            path.symlink_to({'zero': '/dev/zero', 'loop': path.name}.get(name, 'nowhere'))
        yield name, path
    yield 'a long name', folder / ('x' * 5000 + ending)
    yield 'a name in red that is not there', folder / (RED + ending)
