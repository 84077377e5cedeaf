"""MCAP files written chunk by chunk, single messages and whole blocks of them alike."""

import struct
import zlib
from collections import deque
from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Final, Protocol

import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from numpy.typing import NDArray

MAGIC: Final = b'\x89MCAP0\r\n'
_MESSAGE = struct.Struct('<BQHIQQ')
_ENTRY = struct.Struct('<QQ')
_INDEX = struct.Struct('<BQHI')
_FIXED: Final = 22  # bytes of a message record between its length and the message
_THOROUGH: Final = 3  # levels of zstd
_FAST: Final = 1
_MOST_WAITING: Final = 4  # chunks that are being compressed
_HEAD = np.dtype(
    {
        'names': ['code', 'length', 'channel', 'sequence', 'log_time', 'publish_time'],
        'formats': ['u1', '<u8', '<u2', '<u4', '<u8', '<u8'],
        'offsets': [0, 1, 9, 11, 15, 23],
        'itemsize': 31,
    }
)


class Output(Protocol):
    """Destination of a file's bytes."""

    def write(self, data: bytes) -> int:
        """Take bytes."""

    def tell(self) -> int:
        """Return the number of bytes so far."""


@dataclass(frozen=True)
class MessageBlock:
    """Messages of one topic and one size: log times ascending, ns [N]; CDR bytes [N, size]."""

    topic: int
    times: NDArray[np.int64]
    messages: NDArray[np.uint8]


@dataclass(frozen=True)
class Records:
    """Message records one after the other: data[ends[i − 1] : ends[i]] each."""

    data: NDArray[np.uint8]
    ends: NDArray[np.int64]
    times: NDArray[np.int64]
    topics: NDArray[np.int64]

    @classmethod
    def of(cls, blocks: Sequence[MessageBlock]) -> 'Records':
        """Return the records of blocks in the order of their log times, equal ones as given."""
        times = np.concatenate([block.times for block in blocks])
        order = np.argsort(times, kind='stable')
        counts = [len(block.times) for block in blocks]
        sizes = [_HEAD.itemsize + block.messages.shape[1] for block in blocks]
        ends = np.cumsum(np.repeat(sizes, counts)[order])
        data = np.empty(int(ends[-1]), np.uint8)
        place = np.empty(len(order), np.int64)
        place[order] = ends - np.repeat(sizes, counts)[order]
        first = 0
        for block, count, size in zip(blocks, counts, sizes, strict=True):
            rows = np.empty((count, size), np.uint8)
            head = np.zeros(count, _HEAD)
            head['code'], head['length'] = Opcode.MESSAGE, size - 9
            head['channel'] = block.topic
            head['log_time'] = head['publish_time'] = block.times
            rows[:, : _HEAD.itemsize] = head.view(np.uint8).reshape(count, -1)
            rows[:, _HEAD.itemsize :] = block.messages
            # Items of one record at every byte: an assignment copies each record as a whole.
            items = np.ndarray((len(data) - size + 1,), f'V{size}', data, strides=(1,))
            items[place[first : first + count]] = rows.view(f'V{size}')[:, 0]
            first += count
        topics = np.repeat([block.topic for block in blocks], counts)[order]
        return cls(data, ends, times[order], topics)


@dataclass
class _OpenChunk:
    """Records that wait for their chunk to be full, and the index of its messages."""

    data: bytearray = field(default_factory=bytearray)
    index: dict[int, bytearray] = field(default_factory=dict)
    start: int | None = None
    end: int = 0


@dataclass(frozen=True)
class _Packed:
    raw_size: int
    checksum: int
    data: bytes


class ChunkedWriter:
    """
    Header, zstd-compressed chunks with their indices, and summary of an MCAP file.

    A chunk ends once it has more than `chunk_size` bytes, or with `end_chunk`. The bytes are those
    of the mcap library's writer for the same messages. With `parallel`, a thread compresses up to
    four chunks while others are filled, at twice the speed for a file that is a tenth larger.
    """

    def __init__(self, output: Output, chunk_size: int, *, parallel: bool = False) -> None:
        self._output = output
        self._chunk_size = chunk_size
        self._chunk = _OpenChunk()
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._chunks: list[ChunkIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._counts: dict[int, int] = {}
        self._first: int | None = None
        self._last = 0
        self._pool = ThreadPoolExecutor(1, 'zstd') if parallel else None
        self._waiting: deque[tuple[_OpenChunk, Future[_Packed]]] = deque()

    def start(self, profile: str, library: str) -> None:
        """Write magic and header."""
        self._output.write(MAGIC)
        self._write(Header(profile, library))

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Declare a message type and return its number."""
        schema = Schema(id=len(self._schemas) + 1, data=data, encoding=encoding, name=name)
        self._schemas.append(schema)
        self._chunk.data += _bytes(schema)
        return schema.id

    def register_channel(
        self, topic: str, encoding: str, schema: int, metadata: dict[str, str]
    ) -> int:
        """Declare a topic and return its number."""
        number = len(self._channels) + 1
        channel = Channel(number, topic, encoding, metadata, schema)
        self._channels.append(channel)
        self._chunk.data += _bytes(channel)
        return number

    def add_message(self, channel: int, time: int, data: bytes) -> None:
        """Add a message, received and published at `time`, ns."""
        chunk = self._chunk
        entry = _ENTRY.pack(time, len(chunk.data))
        chunk.data += _MESSAGE.pack(Opcode.MESSAGE, _FIXED + len(data), channel, 0, time, time)
        chunk.data += data
        self._count(channel, 1, time, time, entry)
        if len(chunk.data) > self._chunk_size:
            self.end_chunk()

    def room(self, records: Records, start: int) -> int:
        """Return the index after the record, from `start` on, that fills the open chunk."""
        before = records.ends[start - 1] if start else 0
        most = self._chunk_size - len(self._chunk.data) + before
        return int(np.searchsorted(records.ends, most, side='right')) + 1

    def add_records(self, records: Records, start: int, stop: int) -> None:
        """Add records, no more than there is `room` for, and end the chunk where they fill it."""
        chunk = self._chunk
        before = int(records.ends[start - 1]) if start else 0
        part = slice(start, stop)
        begins = np.r_[before, records.ends[start : stop - 1]] - before + len(chunk.data)
        times, topics = records.times[part], records.topics[part]
        found, first = np.unique(topics, return_index=True)
        for channel in found[np.argsort(first)].tolist():
            own = topics == channel
            entries = np.stack([times[own], begins[own]], axis=1).astype('<u8')
            span = int(times[own].min()), int(times[own].max())
            self._count(channel, len(entries), *span, entries.tobytes())
        chunk.data += records.data[before : records.ends[stop - 1]].data
        if len(chunk.data) > self._chunk_size:
            self.end_chunk()

    def end_chunk(self) -> None:
        """End the open chunk, unless it has no messages."""
        chunk = self._chunk
        if chunk.start is None:
            return
        self._chunk = _OpenChunk()
        if self._pool is None:
            self._write_chunk(chunk, _pack(chunk.data, _THOROUGH))
            return
        self._waiting.append((chunk, self._pool.submit(_pack, chunk.data, _FAST)))
        self._write_packed(_MOST_WAITING)

    def flush(self) -> None:
        """End the open chunk and give all chunks to the output."""
        self.end_chunk()
        self._write_packed(0)

    def add_metadata(self, name: str, data: Mapping[str, str]) -> None:
        """Add a metadata record."""
        self._write_packed(0)
        record = _bytes(Metadata(name=name, metadata=dict(data)))
        place = MetadataIndex(offset=self._output.tell(), length=len(record), name=name)
        self._output.write(record)
        self._metadata.append(place)

    def finish(self) -> None:
        """Write the summary and the end of the file."""
        self.flush()
        if self._pool is not None:
            self._pool.shutdown()
        self._write(DataEnd(0))
        start = self._output.tell()
        groups: Sequence[tuple[Opcode, Sequence[McapRecord]]] = (
            (Opcode.SCHEMA, self._schemas),
            (Opcode.CHANNEL, self._channels),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.ATTACHMENT_INDEX, []),
            (Opcode.METADATA_INDEX, self._metadata),
        )
        summary, offsets = b'', []
        for code, members in groups:
            group = b''.join(map(_bytes, members))
            offsets.append(SummaryOffset(code, start + len(summary), len(group)))
            summary += group
        offset_start = start + len(summary)
        summary += b''.join(map(_bytes, offsets))
        head = struct.pack('<BQQQ', Opcode.FOOTER, 8 + 8 + 4, start, offset_start)
        checksum = zlib.crc32(head, zlib.crc32(summary))
        self._output.write(summary)
        self._write(Footer(start, offset_start, checksum))
        self._output.write(MAGIC)

    def _count(self, channel: int, count: int, first: int, last: int, entries: bytes) -> None:
        chunk = self._chunk
        chunk.index.setdefault(channel, bytearray()).extend(entries)
        chunk.start = first if chunk.start is None else min(chunk.start, first)
        chunk.end = max(chunk.end, last)
        self._counts[channel] = self._counts.get(channel, 0) + count
        self._first = first if self._first is None else min(self._first, first)
        self._last = max(self._last, last)

    def _write_packed(self, most_waiting: int) -> None:
        while len(self._waiting) > most_waiting or (self._waiting and self._waiting[0][1].done()):
            chunk, packed = self._waiting.popleft()
            self._write_chunk(chunk, packed.result())

    def _write_chunk(self, chunk: _OpenChunk, packed: _Packed) -> None:
        start = chunk.start or 0
        offset = self._output.tell()
        record = _bytes(
            Chunk('zstd', packed.data, chunk.end, start, packed.checksum, packed.raw_size)
        )
        self._output.write(record)
        places, indices = {}, b''
        for channel, entries in chunk.index.items():
            places[channel] = offset + len(record) + len(indices)
            size = len(entries)
            indices += _INDEX.pack(Opcode.MESSAGE_INDEX, 6 + size, channel, size) + entries
        self._output.write(indices)
        self._chunks.append(
            ChunkIndex(
                message_start_time=start,
                message_end_time=chunk.end,
                chunk_start_offset=offset,
                chunk_length=len(record),
                message_index_offsets=places,
                message_index_length=len(indices),
                compression='zstd',
                compressed_size=len(packed.data),
                uncompressed_size=packed.raw_size,
            )
        )

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            metadata_count=len(self._metadata),
            message_start_time=self._first or 0,
            message_end_time=self._last,
            schema_count=len(self._schemas),
        )

    def _write(self, record: McapRecord) -> None:
        self._output.write(_bytes(record))


def _pack(data: bytearray, level: int) -> _Packed:
    packed = zstandard.ZstdCompressor(level).compress(data)
    return _Packed(len(data), zlib.crc32(data), packed)


def _bytes(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())
