"""Arrays in one file with a checksum each, mapped into memory rather than read."""

import json
import os
import struct
import zlib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

_MAGIC = b'wattwalk arrays\n'
_LENGTH = struct.Struct('<Q')
_LARGEST_HEADER = 1 << 24  # bytes
_ALIGNED = 64  # bytes
_KINDS = ('<f4', '<f8', '<i4', '<i8', '|u1')


class DamagedFileError(ValueError):
    """A file of arrays that is torn, of another format, or not what its checksums say."""


@dataclass(frozen=True)
class ArrayFile:
    """Arrays by name, and what else is known of them as JSON."""

    arrays: Mapping[str, NDArray[Any]]
    about: Mapping[str, Any]

    def write(self, path: Path) -> int:
        """Write under a temporary name, then rename it to path; return its bytes.

        OSError leaves nothing behind. It is not forced to the disk: a power cut may tear it,
        which its checksums tell.
        """
        rows, place = {}, 0
        for name, values in self.arrays.items():
            kind = values.dtype.newbyteorder('<').str
            if kind not in _KINDS:
                raise TypeError(f'{name}: {kind} is none of {", ".join(_KINDS)}')
            rows[name] = (kind, list(values.shape), place, zlib.crc32(_bytes(values)))
            place += _padded(values.nbytes)
        header = json.dumps({'arrays': rows, 'about': self.about}).encode()
        start = len(_MAGIC) + 12
        header += b' ' * (_padded(start + len(header)) - start - len(header))
        temporary = path.with_name(f'.{path.name}.{os.getpid()}')
        try:
            with temporary.open('wb') as file:
                file.write(_MAGIC + _LENGTH.pack(len(header)))
                file.write(struct.pack('<I', zlib.crc32(header)) + header)
                for values in self.arrays.values():
                    file.write(_bytes(values))
                    file.write(b'\0' * (_padded(values.nbytes) - values.nbytes))
                size = file.tell()
            temporary.replace(path)
        except OSError:
            with suppress(OSError):
                temporary.unlink(missing_ok=True)
            raise
        return size

    @classmethod
    def read(cls, path: Path) -> 'ArrayFile':
        """Map a file; OSError where there is none, DamagedFileError for any other content."""
        with path.open('rb') as file:
            start = file.read(len(_MAGIC) + 12)
            if len(start) < len(_MAGIC) + 12 or not start.startswith(_MAGIC):
                raise DamagedFileError(f'{path} holds no arrays')
            (length,) = _LENGTH.unpack_from(start, len(_MAGIC))
            if length > _LARGEST_HEADER:
                raise DamagedFileError(f'{path} is torn')
            header = file.read(length)
        if len(header) < length or zlib.crc32(header) != int.from_bytes(start[-4:], 'little'):
            raise DamagedFileError(f'{path} is torn')
        content = json.loads(header)
        mapped = np.memmap(path, np.uint8, 'r', offset=len(start) + length)
        arrays = {}
        for name, (kind, shape, place, checksum) in content['arrays'].items():
            size = int(np.prod(shape, dtype=np.int64)) * np.dtype(kind).itemsize
            part = mapped[place : place + size]
            if len(part) != size or zlib.crc32(part.data) != checksum:
                raise DamagedFileError(f'{path}: {name} is torn')
            arrays[name] = np.asarray(part).view(kind).reshape(shape)
        return cls(arrays, content['about'])


def _bytes(values: NDArray[Any]) -> memoryview:
    whole = np.ascontiguousarray(values, values.dtype.newbyteorder('<'))
    return whole.reshape(-1).view(np.uint8).data


def _padded(size: int) -> int:
    return -(-size // _ALIGNED) * _ALIGNED
