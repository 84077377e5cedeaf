"""The messages of a ROS 1 bag (version 2.0) in batches, as far as the file is undamaged."""

import bz2
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Final

import lz4.frame
from wattwalk_core.errors import InputError, printable, quoted

from power_recordings.messages.batch import LARGEST, Batch, MessageFile, Topic, joined
from power_recordings.messages.cdr import full_type

_MAGIC: Final = b'#ROSBAG V2.0\n'
_MESSAGE, _BAG, _CHUNK, _CONNECTION = 2, 3, 5, 7
_LENGTH = struct.Struct('<I')
_TIME = struct.Struct('<II')
_LARGEST_HEADER: Final = 1 << 20  # bytes
_MOST_MESSAGES: Final = 2_000_000  # of one chunk

# lz4 raises RuntimeError.
_DAMAGE = (ValueError, struct.error, KeyError, IndexError, EOFError, OSError, RuntimeError)
Header = dict[bytes, bytes]


class Ros1File(MessageFile):
    """A ROS 1 bag, read from front to back without its index.

    Raises InputError for a file that is not one, or unpacks to far more than it can hold.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        with path.open('rb') as file:
            if file.read(len(_MAGIC)) != _MAGIC:
                raise InputError(f'{path}: not a bag: it does not begin with #ROSBAG V2.0')

    def batches(self) -> Iterator[Batch]:
        """Yield the messages; damaged parts are left out and noted in `problems`."""
        with self.path.open('rb') as file:
            file.seek(len(_MAGIC))
            try:
                while (header := self._header(file)) is not None:
                    code = header.get(b'op', b'\0')[0]
                    data = self._data(file, keep=code in (_CHUNK, _CONNECTION))
                    if code == _CONNECTION:
                        self._declare(header, data)
                    elif code == _CHUNK:
                        yield from self._messages(self._unpacked(header, data))
            except _DAMAGE as error:
                reason = printable(str(error))
                self.problems.append(f'{self.path.name} is cut off or damaged: {reason}')

    def _header(self, file: IO[bytes]) -> Header | None:
        length = file.read(4)
        if not length:
            return None
        (size,) = _LENGTH.unpack(length)
        if size > min(_LARGEST_HEADER, self._size - file.tell()):
            raise ValueError(f'a header of {size} bytes')
        return _fields(file.read(size))

    def _data(self, file: IO[bytes], *, keep: bool) -> bytes:
        (size,) = _LENGTH.unpack(file.read(4))
        if size > self._size - file.tell():
            raise ValueError(f'a record of {size} bytes, {self._size - file.tell()} are left')
        if not keep:
            file.seek(size, 1)
            return b''
        if size > LARGEST:
            raise ValueError(f'a chunk of {size} bytes; at most {LARGEST} are read')
        return file.read(size)

    def _declare(self, header: Header, data: bytes) -> None:
        about = _fields(data)
        (number,) = _LENGTH.unpack(header[b'conn'])
        self.topics[number] = Topic(
            header[b'topic'].decode('utf-8', 'replace'),
            full_type(about[b'type'].decode('utf-8', 'replace')),
            'ros1',
            about[b'message_definition'].decode('utf-8', 'replace'),
        )

    def _unpacked(self, header: Header, data: bytes) -> bytes:
        compression = header[b'compression']
        (size,) = _LENGTH.unpack(header[b'size'])
        if size > LARGEST:
            raise ValueError(f'a chunk of {size} bytes; at most {LARGEST} are read')
        if compression == b'bz2':
            data = bz2.BZ2Decompressor().decompress(data, size + 1)
        elif compression == b'lz4':
            data = lz4.frame.LZ4FrameDecompressor().decompress(data, size + 1)
        elif compression != b'none':
            raise ValueError(f'chunks are compressed by {quoted(compression)}')
        if len(data) != size:
            raise ValueError(f'a chunk of {len(data)} bytes instead of {size}')
        self._count_unpacked(size)
        return data

    def _messages(self, chunk: bytes) -> Iterator[Batch]:
        found: dict[int, list[tuple[int, bytes]]] = {}
        position = count = 0
        while position < len(chunk):
            (size,) = _LENGTH.unpack_from(chunk, position)
            header = _fields(chunk[position + 4 : position + 4 + size])
            position += 4 + size
            (size,) = _LENGTH.unpack_from(chunk, position)
            position += 4
            if position + size > len(chunk):
                raise ValueError(f'a message of {size} bytes in a chunk of {len(chunk)}')
            data = chunk[position : position + size]
            position += size
            code = header[b'op'][0]
            if code == _CONNECTION:
                self._declare(header, data)
            elif code == _MESSAGE:
                (number,) = _LENGTH.unpack(header[b'conn'])
                seconds, nanoseconds = _TIME.unpack(header[b'time'])
                found.setdefault(number, []).append((seconds * 10**9 + nanoseconds, data))
                count += 1
                if count > _MOST_MESSAGES:
                    raise ValueError(f'more than {_MOST_MESSAGES} messages in a chunk')
        for number, messages in found.items():
            if number in self.topics:
                yield joined(self.topics[number], messages)


def _fields(data: bytes) -> Header:
    """Return the `name=value` fields of a header; ValueError for a damaged one."""
    found: Header = {}
    position = 0
    while position < len(data):
        (size,) = _LENGTH.unpack_from(data, position)
        name, equals, value = data[position + 4 : position + 4 + size].partition(b'=')
        position += 4 + size
        if not equals or position > len(data):
            raise ValueError('a damaged header')
        found[name] = value
    return found
