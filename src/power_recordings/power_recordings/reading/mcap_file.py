"""The messages of an MCAP file in batches, as far as the file is undamaged."""

import struct
import zlib
from collections.abc import Iterator, Sequence
from io import BytesIO
from itertools import chain
from pathlib import Path

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Channel, Schema
from numpy.typing import NDArray
from wattwalk_core.errors import InputError, printable, quoted

from power_recordings.messages.batch import (
    LARGEST,
    Batch,
    Integers,
    MessageFile,
    Skip,
    Topic,
    windows,
)

MAGIC = b'\x89MCAP0\r\n'
_RECORD = struct.Struct('<BQ')
_MESSAGE = struct.Struct('<BQHIQQ')
_CHUNK = struct.Struct('<QQQII')
_LATEST = 2**63 - 1  # ns
_FIXED = 22  # bytes of a message record before the message itself
_LOOSE = 8192
_ENTRY = np.dtype([('time', '<u8'), ('offset', '<u8')])
_LARGEST_TEXT = 1 << 20  # bytes of the definition of a type or topic
_NEEDED = {
    Opcode.CHUNK: LARGEST,
    Opcode.MESSAGE: LARGEST,
    Opcode.MESSAGE_INDEX: LARGEST,
    Opcode.SCHEMA: _LARGEST_TEXT,
    Opcode.CHANNEL: _LARGEST_TEXT,
}
_DECLARING = 4  # chunks at the start of a file that are read in any case
_MOST_SCANNED = 2_000_000  # messages of a chunk without index
_MOST_PROBLEMS = 50


_Found = dict[int, tuple[Integers, Integers, Integers]]  # offsets, sizes and log times by channel


class McapFile(MessageFile):
    """An MCAP file, read from front to back without its index.

    Raises InputError for a file that is not MCAP, is empty, uses a compression that is not known,
    or unpacks to far more than it can hold.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._schemas: dict[int, tuple[str, str]] = {}  # name and definition
        with path.open('rb') as file:
            start = file.read(len(MAGIC))
        if not start:
            raise InputError(f'{path} is empty: nothing was recorded')
        if start != MAGIC[: len(start)]:
            raise InputError(f'{path} is not an MCAP file: it begins with {start!r}')

    def batches(self, skip: Skip = None, every: int = 1) -> Iterator[Batch]:
        """Yield the messages; damaged parts are left out and noted in `problems`.

        skip: returns whether to omit a chunk with an index, given its numbers of messages by
        topic. every: of chunks after the first few, which declare the topics, only
        every n-th is read from the disk.
        """
        packed: bytes | None = None
        indices: list[bytes] = []
        loose: list[bytes] = []
        for code, body in chain(self._records(every), [(Opcode.FOOTER, b'')]):
            if code == Opcode.MESSAGE_INDEX and packed is not None:
                indices.append(body)
                continue
            if packed is not None:
                yield from self._unpacked(packed, indices, skip)
                packed, indices = None, []
            if code == Opcode.CHUNK:
                packed = body
            elif code == Opcode.MESSAGE:
                loose += (_RECORD.pack(code, len(body)), body)
            else:
                self._declare(code, body)
            if loose and (len(loose) >= _LOOSE or code == Opcode.FOOTER):
                yield from self._batches(_Records(b''.join(loose)))
                loose = []

    def _problem(self, text: str) -> None:
        if len(self.problems) < _MOST_PROBLEMS:
            self.problems.append(f'{self.path.name}{text}')

    def _records(self, every: int) -> Iterator[tuple[int, bytes]]:
        """Yield code and content of the records that are needed, up to the end or a damage."""
        chunks, passed = 0, False
        with self.path.open('rb') as file:
            position = file.seek(len(MAGIC))
            while len(head := file.read(_RECORD.size)) == _RECORD.size:
                code, length = _RECORD.unpack(head)
                position += _RECORD.size
                if code == Opcode.FOOTER:
                    return
                if not code or length > self._size - position:
                    position -= _RECORD.size
                    break
                if code == Opcode.CHUNK:
                    chunks += 1
                    passed = chunks > _DECLARING and chunks % every != 0
                most = _NEEDED.get(code, -1)
                if passed and code in (Opcode.CHUNK, Opcode.MESSAGE_INDEX):
                    most = -1
                if 0 <= most < length:
                    self._problem(f': a record of {length >> 20} MiB was left out')
                if length > most:
                    file.seek(length, 1)
                else:
                    yield code, file.read(length)
                position += length
        lost = self._size - position
        half = f'; {lost} bytes of an unfinished chunk at its end are lost' if lost else ''
        self._problem(f' was not closed (no index){half}')

    def _declare(self, code: int, body: bytes) -> None:
        if code not in (Opcode.SCHEMA, Opcode.CHANNEL):
            return
        stream = ReadDataStream(BytesIO(body))
        try:
            record = (Schema if code == Opcode.SCHEMA else Channel).read(stream)
        except (struct.error, EndOfFile, UnicodeDecodeError) as error:
            self._problem(f': a damaged record was left out ({error})')
            return
        if isinstance(record, Schema):
            known = record.encoding in ('ros2msg', 'ros2idl', 'ros1msg')
            text = record.data.decode('utf-8', 'replace') if known else ''
            self._schemas[record.id] = record.name, text
        else:
            name, text = self._schemas.get(record.schema_id, ('', ''))
            self.topics[record.id] = Topic(record.topic, name, record.message_encoding, text)

    def _unpacked(self, body: bytes, indices: Sequence[bytes], skip: Skip) -> Iterator[Batch]:
        if skip is not None and indices:
            listed = _by_channel(indices)
            known = listed.keys() <= self.topics.keys()
            if known and skip({self.topics[c].name: len(own) for c, own in listed.items()}):
                return
        try:
            raw = _chunk(body, self.path)
        except (ValueError, struct.error, zstandard.ZstdError, RuntimeError, MemoryError) as error:
            self._problem(f': a damaged chunk was left out ({printable(str(error))})')
            return
        self._count_unpacked(len(raw))
        yield from self._batches(_Records(raw), indices)

    def _batches(self, records: '_Records', indices: Sequence[bytes] = ()) -> Iterator[Batch]:
        found = records.indexed(indices)
        if found is None:
            for code, start, length in records:
                if code != Opcode.MESSAGE:
                    self._declare(code, records.raw[start : start + length])
            try:
                found = records.scanned()
            except ValueError as error:
                self._problem(f': a damaged chunk was left out ({error})')
                return
            if records.lost:
                self._problem(f': {records.lost} bytes of a chunk are damaged')
        for channel, (offsets, sizes, times) in found.items():
            if channel in self.topics:
                yield Batch(self.topics[channel], records.data, offsets, sizes, times)


class _Records:
    """Records in memory; iteration gives code, start and length of each."""

    def __init__(self, raw: bytes) -> None:
        self.raw = raw
        self.data = np.frombuffer(raw, np.uint8)
        self.lost = 0  # bytes at which the last iteration ended early

    def __iter__(self) -> Iterator[tuple[int, int, int]]:
        position, end = 0, len(self.raw)
        self.lost = 0
        while position + _RECORD.size <= end:
            code, length = _RECORD.unpack_from(self.raw, position)
            start = position + _RECORD.size
            position = start + length
            if position > end or not code:
                self.lost = end - start + _RECORD.size
                return
            yield code, start, length

    def indexed(self, indices: Sequence[bytes]) -> _Found | None:
        """Return offsets, sizes and log times of the messages by channel, from index records.

        None unless they cover every byte.
        """
        found: _Found = {}
        total = 0
        for channel, entries in _by_channel(indices).items():
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
            if lengths.min() < _FIXED or (offsets + lengths).max() + _RECORD.size > len(self.data):
                return None
            total += int(lengths.sum()) + len(offsets) * _RECORD.size
            times = np.minimum(entries['time'], _LATEST).astype(np.int64)
            found[channel] = (offsets + _MESSAGE.size, lengths - _FIXED, times)
        return found if total == len(self.data) else None

    def scanned(self) -> _Found:
        """Return the same as `indexed`, found record by record; ValueError for too many."""
        rows = []
        for code, start, length in self:
            if code == Opcode.MESSAGE and length >= _FIXED:
                _, _, channel, _, time, _ = _MESSAGE.unpack_from(self.raw, start - _RECORD.size)
                rows.append((channel, min(time, _LATEST), start, length))
                if len(rows) > _MOST_SCANNED:
                    raise ValueError(f'more than {_MOST_SCANNED} messages without index')
        table = np.array(rows, np.int64).reshape(-1, 4)
        found: _Found = {}
        for channel in np.unique(table[:, 0]).tolist():
            _, times, starts, lengths = table[table[:, 0] == channel].T
            found[channel] = (starts + _FIXED, lengths - _FIXED, times)
        return found


def _by_channel(indices: Sequence[bytes]) -> dict[int, NDArray[np.void]]:
    """Return times and offsets of messages by channel; of index records, one lists a channel."""
    return {
        int.from_bytes(raw[:2], 'little'): np.frombuffer(raw[6:], _ENTRY, (len(raw) - 6) // 16)
        for raw in indices
    }


def _chunk(body: bytes, path: Path) -> bytes:
    """Return the records of a chunk; ValueError if its checksum or size is wrong."""
    _, _, size, checksum, name_length = _CHUNK.unpack_from(body)
    name_end = _CHUNK.size + name_length
    compression = body[_CHUNK.size : name_end].decode()
    packed = memoryview(body)[name_end + 8 :]
    if size > LARGEST:
        raise ValueError(f'{size} bytes; at most {LARGEST} are read')
    if compression == 'zstd':
        if zstandard.frame_content_size(packed) > size:
            raise ValueError(f'more than its {size} bytes')
        raw = zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)
    elif compression == 'lz4':
        raw = lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size + 1)
    elif compression == '':
        raw = bytes(packed)
    else:
        raise InputError(
            f'{path}: chunks are compressed by {quoted(compression)}; convert the bag to zstd'
        )
    if len(raw) != size:
        raise ValueError(f'{len(raw)} bytes instead of {size}')
    if checksum and zlib.crc32(raw) != checksum:
        raise ValueError('wrong checksum')
    return raw
