"""The messages of an MCAP file in batches, as far as the file is undamaged."""

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Channel, Schema
from numpy.typing import NDArray
from wattwalk_core.errors import InputError

MAGIC = b'\x89MCAP0\r\n'
_RECORD = struct.Struct('<BQ')
_MESSAGE = struct.Struct('<BQHIQQ')
_CHUNK = struct.Struct('<QQQII')
_FIXED = 22  # bytes of a message record before the message itself
_LONGEST = 1 << 31
_LOOSE = 8192
_ENTRY = np.dtype([('time', '<u8'), ('offset', '<u8')])

Integers = NDArray[np.int64]
_Found = dict[int, tuple[Integers, Integers, Integers]]


@dataclass(frozen=True)
class Topic:
    """A topic as the file declares it; `definition` is the text of its message type."""

    name: str
    type_name: str
    encoding: str
    definition: str


@dataclass(frozen=True)
class Batch:
    """Messages of one topic in recorded order: data[offset : offset + size] of each."""

    topic: Topic
    data: NDArray[np.uint8]
    offsets: Integers
    sizes: Integers
    log_times: Integers  # ns


def windows(data: NDArray[np.uint8], size: int) -> NDArray[np.uint8]:
    """Return all windows of `size` bytes, [len(data) − size + 1, size], without copying."""
    return np.ndarray((len(data) - size + 1, size), np.uint8, data, strides=(1, 1))


class McapFile:
    """
    An MCAP file, read from front to back without its index.

    `problems` is complete once `batches` is exhausted. Raises InputError for a file that is not
    MCAP, is empty, or uses a compression that is not known.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.problems: list[str] = []
        self.topics: dict[int, Topic] = {}
        self._schemas: dict[int, Schema] = {}
        try:
            with path.open('rb') as file:
                start = file.read(len(MAGIC))
        except OSError as error:
            raise InputError(f'cannot read {path}: {error.strerror}') from error
        if not start:
            raise InputError(f'{path} is empty: nothing was recorded')
        if start != MAGIC[: len(start)]:
            raise InputError(f'{path} is not an MCAP file: it begins with {start!r}')

    def batches(self) -> Iterator[Batch]:
        """Yield the messages; damaged parts are left out and noted in `problems`."""
        chunk: _Chunk | None = None
        loose: list[bytes] = []
        for code, body in self._records():
            if code == Opcode.MESSAGE_INDEX and chunk is not None:
                chunk.add_index(body)
                continue
            if chunk is not None:
                yield from self._batches(chunk)
                chunk = None
            if code == Opcode.CHUNK:
                chunk = self._open_chunk(body)
            elif code == Opcode.MESSAGE:
                loose += (_RECORD.pack(code, len(body)), body)
            else:
                self._declare(code, body)
            if len(loose) >= _LOOSE:
                yield from self._batches(_Records(b''.join(loose)))
                loose = []
        if chunk is not None:
            yield from self._batches(chunk)
        if loose:
            yield from self._batches(_Records(b''.join(loose)))

    def _records(self) -> Iterator[tuple[int, bytes]]:
        with self.path.open('rb') as file:
            file.seek(len(MAGIC))
            while len(head := file.read(_RECORD.size)) == _RECORD.size:
                code, length = _RECORD.unpack(head)
                if code == Opcode.FOOTER:
                    return
                body = file.read(length) if length <= _LONGEST else b''
                if len(body) < length:
                    head += body
                    break
                yield code, body
        half = f'; {len(head)} bytes of an unfinished chunk at its end are lost' if head else ''
        self.problems.append(f'{self.path.name} was not closed (no index){half}')

    def _declare(self, code: int, body: bytes) -> None:
        if code not in (Opcode.SCHEMA, Opcode.CHANNEL):
            return
        stream = ReadDataStream(BytesIO(body))
        try:
            record = (Schema if code == Opcode.SCHEMA else Channel).read(stream)
        except (struct.error, EndOfFile, UnicodeDecodeError) as error:
            self.problems.append(f'{self.path.name}: a damaged record was left out ({error})')
            return
        if isinstance(record, Schema):
            self._schemas[record.id] = record
        else:
            channel = record
            schema = self._schemas.get(channel.schema_id, Schema(0, b'', '', ''))
            text = schema.data.decode('utf-8', 'replace') if schema.encoding == 'ros2msg' else ''
            self.topics[channel.id] = Topic(
                channel.topic, schema.name, channel.message_encoding, text
            )

    def _open_chunk(self, body: bytes) -> '_Chunk | None':
        try:
            return _Chunk(body, self.path)
        except (ValueError, struct.error, zstandard.ZstdError, RuntimeError, MemoryError) as error:
            self.problems.append(f'{self.path.name}: a damaged chunk was left out ({error})')
            return None

    def _batches(self, records: '_Records') -> Iterator[Batch]:
        found = records.indexed()
        if found is None:
            for code, start, length in records:
                if code != Opcode.MESSAGE:
                    self._declare(code, records.raw[start : start + length])
            found = records.scanned()
        for channel, (offsets, sizes, times) in found.items():
            if channel in self.topics:
                yield Batch(self.topics[channel], records.data, offsets, sizes, times)


class _Records:
    """Records in memory; iteration gives code, start and length of each."""

    def __init__(self, raw: bytes) -> None:
        self.raw = raw
        self.data = np.frombuffer(raw, np.uint8)
        self._index: dict[int, NDArray[np.void]] = {}

    def __iter__(self) -> Iterator[tuple[int, int, int]]:
        position, end = 0, len(self.raw)
        while position + _RECORD.size <= end:
            code, length = _RECORD.unpack_from(self.raw, position)
            start = position + _RECORD.size
            position = start + length
            if position > end:
                return
            yield code, start, length

    def add_index(self, body: bytes) -> None:
        """Keep a message index record, which lists the messages of one channel."""
        entries = body[6 : 6 + (len(body) - 6) // 16 * 16]
        self._index[int.from_bytes(body[:2], 'little')] = np.frombuffer(entries, _ENTRY)

    def indexed(self) -> _Found | None:
        """
        Return offsets, sizes and log times of the messages by channel, from the index.

        None unless the index covers every byte.
        """
        found: _Found = {}
        total = 0
        for channel, entries in self._index.items():
            if not len(entries):
                continue
            offsets = entries['offset'].astype(np.int64)
            if offsets.min() < 0 or offsets.max() + _MESSAGE.size > len(self.data):
                return None
            heads = windows(self.data, 11)[offsets]
            lengths = np.ascontiguousarray(heads[:, 1:9]).view('<i8')[:, 0]
            channels = np.ascontiguousarray(heads[:, 9:11]).view('<u2')[:, 0]
            if (heads[:, 0] != Opcode.MESSAGE).any() or (channels != channel).any():
                return None
            total += int(lengths.sum()) + len(offsets) * _RECORD.size
            times = entries['time'].astype(np.int64)
            found[channel] = (offsets + _MESSAGE.size, lengths - _FIXED, times)
        return found if total == len(self.data) else None

    def scanned(self) -> _Found:
        """Return the same as `indexed`, found record by record."""
        rows = [
            (*_MESSAGE.unpack_from(self.raw, start - _RECORD.size)[2:5:2], start, length)
            for code, start, length in self
            if code == Opcode.MESSAGE and length >= _FIXED
        ]
        table = np.array(rows, np.int64).reshape(-1, 4)
        found: _Found = {}
        for channel in np.unique(table[:, 0]).tolist():
            _, times, starts, lengths = table[table[:, 0] == channel].T
            found[channel] = (starts + _FIXED, lengths - _FIXED, times)
        return found


class _Chunk(_Records):
    """An unpacked chunk; ValueError if its checksum or size is wrong."""

    def __init__(self, body: bytes, path: Path) -> None:
        _, _, size, checksum, name_length = _CHUNK.unpack_from(body)
        name_end = _CHUNK.size + name_length
        compression = body[_CHUNK.size : name_end].decode()
        packed = memoryview(body)[name_end + 8 :]
        if compression == 'zstd':
            raw = zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)
        elif compression == 'lz4':
            raw = lz4.frame.decompress(packed)
        elif compression == '':
            raw = bytes(packed)
        else:
            raise InputError(
                f'{path}: chunks are compressed by {compression!r}; convert the bag to zstd'
            )
        if len(raw) != size:
            raise ValueError(f'{len(raw)} bytes instead of {size}')
        if checksum and zlib.crc32(raw) != checksum:
            raise ValueError('wrong checksum')
        super().__init__(raw)
