"""Hostile bags made on purpose: bombs, lies, loops and names."""

import bz2
import sqlite3
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

import lz4.frame
import numpy as np
from hostile_files import LONG, RED, START
from power_recordings.messages import cdr

_MAGIC = b'\x89MCAP0\r\n'
_BLOCK = 1 << 17
_FAR = 200 << 20  # bytes


def zstd_zeros(size: int, *, says: bool) -> bytes:
    """Zeros in run-length blocks: 131 kB unpack to 4 GB. says: the frame tells its size."""
    head = b'\x28\xb5\x2f\xfd' + (b'\xc0\x58' + struct.pack('<Q', size) if says else b'\x00\x58')
    blocks = -(-size // _BLOCK)
    body = b''.join(
        struct.pack('<I', (_BLOCK << 3) | 2 | (i == blocks - 1))[:3] + b'\0' for i in range(blocks)
    )
    return head + body


def record(code: int, body: bytes, length: int | None = None) -> bytes:
    return struct.pack('<BQ', code, len(body) if length is None else length) + body


def text(value: str | bytes) -> bytes:
    raw = value.encode() if isinstance(value, str) else value
    return struct.pack('<I', len(raw)) + raw


def chunk(raw: bytes, packing: str = '', size: int | None = None, crc: int | None = None) -> bytes:
    known = len(raw) if size is None else size
    return record(
        6,
        struct.pack('<QQQI', START, START, known, zlib.crc32(raw) if crc is None else crc)
        + text(packing)
        + struct.pack('<Q', len(raw))
        + raw,
    )


def message(data: bytes, time: int = START, topic: int = 1) -> bytes:
    return record(5, struct.pack('<HIQQ', topic, 0, time, time) + data)


def declared(
    name: str = '/joint_states',
    kind: str = cdr.JOINT_STATE,
    definition: str | None = None,
    encoding: str = 'cdr',
) -> bytes:
    words = cdr.definition(cdr.JOINT_STATE) if definition is None else definition
    return record(3, struct.pack('<H', 1) + text(kind) + text('ros2msg') + text(words)) + record(
        4, struct.pack('<HH', 1, 1) + text(name) + text(encoding) + text('')
    )


def mcap(*records: bytes, closed: bool = True) -> bytes:
    end = record(15, bytes(4)) + record(2, bytes(20)) + _MAGIC if closed else b''
    return _MAGIC + record(1, text('ros2') + text('')) + b''.join(records) + end


def joint_messages(count: int = 60, names: tuple[str, ...] = ('HIP', 'KNEE')) -> list[bytes]:
    stamps = START + np.arange(count) * 10_000_000
    angle = np.sin(np.arange(count) / 10)[:, None] + np.arange(len(names))
    return cdr.in_a_list(cdr.joint_state_block(stamps, names, angle, angle, angle))


def named(name: str) -> bytes:
    """Return a joint state of a drive whose name may be too long to be encoded in a block."""
    values = {'position': [0.0], 'velocity': [0.0], 'effort': [0.0]}
    return cdr.serialize(cdr.JOINT_STATE, cdr.message(cdr.JOINT_STATE, name=[name], **values))


def mcap_files() -> Iterator[tuple[str, bytes]]:
    good = b''.join(message(m, START + i * 10**7) for i, m in enumerate(joint_messages()))
    huge = 4 << 30
    for says in (True, False):
        bomb = zstd_zeros(huge, says=says)
        for size in (huge, 1000, 2**63 - 1, 2**64 - 1, _FAR):
            yield (
                f'131 kB that unpack to 4 GB, {"told, " * says}size {size}',
                mcap(declared(), chunk(bomb, 'zstd', size, 0)),
            )
    bombs = b''.join(
        chunk(zstd_zeros(200 << 20, says=True), 'zstd', 200 << 20, 0) for _ in range(9)
    )
    yield 'many chunks of zeros', mcap(declared(), bombs)
    packed = lz4.frame.compress(bytes(32 << 20))
    for size in (32 << 20, 1000, 2**62):
        yield f'lz4 of zeros, size {size}', mcap(declared(), chunk(packed, 'lz4', size, 0))
    for size in (0, 1, len(good) - 1, len(good) + 1, 2**31, 2**63, 2**64 - 1):
        yield f'a chunk that lies: {size}', mcap(declared(), chunk(good, '', size), message(b''))
    yield 'a wrong checksum', mcap(declared(), chunk(good, crc=1))
    yield 'an unknown compression', mcap(declared(), chunk(good, RED))
    for code in (1, 3, 4, 5, 6, 7, 8, 9, 10, 12, 15, 0, 200):
        for length in (2**31, 2**63 - 1, 2**63, 2**64 - 1):
            yield (
                f'record {code} of {length} bytes',
                mcap(declared(), chunk(good), record(code, b'x' * 50, length), closed=False),
            )
    for name, made in (
        ('a long topic', declared(LONG)),
        ('a topic in red', declared(f'/{RED}/joint_states')),
        ('a long type', declared(kind=f'a/msg/{LONG}')),
        ('a type in red', declared(kind=RED)),
        ('no type', declared(kind='')),
        ('json', declared(encoding='json')),
        ('an encoding in red', declared(encoding=RED)),
        ('a definition of blank lines', declared(definition='\n' * 200_000)),
        ('a long definition', declared(definition='float64 a\n' * 90_000)),
        ('a definition of noise', declared(definition='[[[((({{{' * 1000)),
        ('another definition', declared(definition='float64 x')),
        ('a type in itself', declared('/a', 'p/msg/T', 'p/T t')),
        ('a type in itself, many times', declared('/a', 'p/msg/T', 'p/T[3] t\np/T[] u')),
        ('a huge array', declared('/a', 'p/msg/T', 'float64[99999999999999999999] t')),
        (
            'empty types without end',
            declared('/a', 'p/msg/T', f'E[999999999] t\n{"=" * 80}\nMSG: p/E'),
        ),
        ('texts without end', declared('/a', 'p/msg/T', 'string[999999999] t')),
    ):
        yield name, mcap(made, chunk(good))
    for length in (5000, 100_000):
        names = [f'{i:05}{"j" * length}' for i in range(60)]
        yield (
            f'{len(names)} names of {length} bytes',
            mcap(declared(), *(message(named(name)) for name in names)),
        )
    yield (
        'a joint in red',
        mcap(
            declared(), *(message(m, START + i) for i, m in enumerate(joint_messages(60, (RED,))))
        ),
    )
    yield 'records of nothing', mcap(declared(), chunk(bytes(1 << 20)))
    yield 'messages of nothing', mcap(declared(), chunk(message(b'') * 20_000))
    yield (
        'messages of one byte to a topic that is not there',
        mcap(chunk(message(b'x', topic=9) * 99)),
    )
    yield (
        'times at the end of numbers',
        mcap(declared(), *(message(m, 2**64 - 1 - i) for i, m in enumerate(joint_messages()))),
    )
    for entries in ([2**63], [2**64 - 1], [0] * 60, [len(good) - 3], list(range(60))):
        body = struct.pack('<H', 1) + struct.pack('<I', 16 * len(entries))
        body += b''.join(struct.pack('<QQ', START, place) for place in entries)
        yield f'an index to {entries[0]}', mcap(declared(), chunk(good), record(7, body))
    yield 'a record in pieces', mcap(record(3, b'\xff' * 40), record(4, b'\xff' * 40), chunk(good))
    yield (
        'a thousand bad records',
        mcap(*([record(4, b'\xff' * 10)] * 1000), declared(), chunk(good)),
    )
    whole = mcap(declared(), chunk(good), chunk(zstd_zeros(1000, says=True), 'zstd', 1000))
    for place in range(1, len(whole), max(len(whole) // 60, 1)):
        yield f'cut off after {place} bytes', whole[:place]


def sqlite_files(folder: Path) -> Iterator[tuple[str, bytes]]:
    topics = 'CREATE TABLE topics(id INTEGER, name TEXT, type TEXT, serialization_format TEXT);'
    one = f"INSERT INTO topics VALUES (1, '/joint_states', '{cdr.JOINT_STATE}', 'cdr');"
    plain = 'CREATE TABLE messages(id INTEGER, topic_id INTEGER, timestamp INTEGER, data BLOB);'
    loop = (
        'CREATE VIEW messages AS WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM n)'
        " SELECT x AS id, 1 AS topic_id, x AS timestamp, x'00' AS data FROM n;"
    )
    grown = (
        'CREATE TABLE messages(id INTEGER, topic_id INTEGER, timestamp INTEGER,'
        ' data BLOB GENERATED ALWAYS AS (zeroblob(900000000)) VIRTUAL);'
        'INSERT INTO messages VALUES (1, 1, 1);'
    )
    for name, script in (
        ('no tables', 'CREATE TABLE other(x);'),
        ('no messages', topics + one + plain),
        ('messages that are computed without end', topics + one + loop),
        ('messages that are computed and large', topics + one + grown),
        ('an indexed text', 'CREATE VIRTUAL TABLE messages USING fts5(id, data);' + topics),
        (
            'a topic that is not there',
            topics + plain + 'INSERT INTO messages VALUES (1, 9, 1, 1);',
        ),
        (
            'times that are texts',
            topics + one + plain + "INSERT INTO messages VALUES (1, 1, 'x', 'y');",
        ),
        ('times below zero', topics + one + plain + 'INSERT INTO messages VALUES (1, 1, -5, 1);'),
        ('no data', topics + one + plain + 'INSERT INTO messages VALUES (1, 1, 5, NULL);'),
        ('data of a byte', topics + one + plain + "INSERT INTO messages VALUES (1, 1, 5, x'00');"),
        (
            'topics of nothing',
            topics + plain + 'INSERT INTO topics VALUES (NULL, NULL, NULL, NULL);',
        ),
        (
            'a long topic',
            topics + plain + f"INSERT INTO topics VALUES (1, '{LONG}', 'a/b', 'cdr');",
        ),
        ('tables without columns', 'CREATE TABLE topics(x); CREATE TABLE messages(y);'),
    ):
        path = folder / 'made.db3'
        path.unlink(missing_ok=True)
        database = sqlite3.connect(path)
        database.executescript(script)
        database.commit()
        database.close()
        yield name, path.read_bytes()


def ros1_files() -> Iterator[tuple[str, bytes]]:
    def fields(**values: bytes) -> bytes:
        parts = (k.encode() + b'=' + v for k, v in values.items())
        return b''.join(struct.pack('<I', len(p)) + p for p in parts)

    def part(data: bytes, **head: bytes) -> bytes:
        return text(fields(**head)) + text(data)

    number = struct.Struct('<I').pack
    magic = b'#ROSBAG V2.0\n'
    about = fields(type=b'sensor_msgs/JointState', md5sum=b'0', message_definition=b'float64 x')
    topic = part(about, op=b'\x07', conn=number(1), topic=b'/joint_states')
    data = part(bytes(8), op=b'\x02', conn=number(1), time=bytes(8))
    zeros = bz2.compress(bytes(20 << 20))
    for name, body in (
        ('nothing', b''),
        ('a header of 4 GB', b'\xff' * 4),
        ('a record of 4 GB', text(fields(op=b'\x05')) + b'\xff' * 4),
        ('bz2 of zeros', part(zeros, op=b'\x05', compression=b'bz2', size=number(20 << 20))),
        ('bz2 that lies', part(zeros, op=b'\x05', compression=b'bz2', size=number(1000))),
        ('bz2 of 4 GB', part(zeros, op=b'\x05', compression=b'bz2', size=b'\xff' * 4)),
        ('lz4 that is none', part(zeros, op=b'\x05', compression=b'lz4', size=number(1000))),
        ('a compression in red', part(b'', op=b'\x05', compression=RED.encode(), size=number(0))),
        ('no compression', part(b'', op=b'\x05')),
        ('fields without a name', text(text(b'novalue')) + text(b'')),
        ('a field of 4 GB', text(b'\xff' * 4 + b'op=1') + text(b'')),
        ('an empty op', part(b'', op=b'')),
        ('no topic', part(about, op=b'\x07', conn=number(1))),
        ('a topic without type', part(b'', op=b'\x07', conn=number(1), topic=b'/a')),
        ('a long topic', part(about, op=b'\x07', conn=number(1), topic=LONG.encode())),
    ):
        yield name, magic + body
    for name, body in (
        ('a message', topic + data),
        ('messages of other topics', data * 50),
        ('messages without time', topic + part(b'', op=b'\x02', conn=number(1))),
        ('a message that ends late', topic + text(fields(op=b'\x02')) + number(1000)),
    ):
        yield name, magic + part(body, op=b'\x05', compression=b'none', size=number(len(body)))
    yield 'another version', b'#ROSBAG V1.2\n' + topic
    yield 'one line without end', b'#ROSBAG V2.0' + b'x' * (5 << 20)
