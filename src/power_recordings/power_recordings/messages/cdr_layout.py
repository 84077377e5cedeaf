"""Offsets of numbers in CDR bytes, to encode and decode many messages of one form at once."""

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from rosbags.interfaces import Nodetype
from wattwalk_core.arrays import Bools

Bytes = NDArray[np.uint8]

_ORDERS = {b'\x00\x00': '>', b'\x00\x01': '<'}
_DTYPES = dict.fromkeys(('bool', 'byte', 'octet', 'char'), 'u1')
_DTYPES |= {'float32': 'f4', 'float64': 'f8'}
_DTYPES |= {f'{sign}int{8 * n}': f'{sign or "i"}{n}' for sign in ('', 'u') for n in (1, 2, 4, 8)}
_MOST_FIELDS = 50_000
_LONGEST_TEXT = 4096  # bytes


@dataclass(frozen=True)
class Column:
    """Place of a field in a message: byte offset, type, and array length (None for a scalar)."""

    offset: int
    dtype: 'np.dtype[Any]'
    count: int | None

    @property
    def end(self) -> int:
        """Offset of the byte after the last number."""
        return self.offset + self.dtype.itemsize * (1 if self.count is None else self.count)


class Layout:
    """Offsets of all numbers in a message, taken from an example.

    They are valid for all messages of the type with the same strings and array lengths.
    Keys of `columns` and `strings` are dotted paths, e.g. `header.stamp.sec`. fields: definitions
    of types by name, as in a typestore's `fielddefs`. is_ros1: the messages are as ROS 1 writes
    them, not CDR. Raises ValueError for an example that is cut off or not plain CDR (XCDR version
    1), and for a type that contains itself, has too many fields or texts of more than 4 KiB.
    """

    def __init__(
        self, fields: Mapping[str, Any], type_name: str, example: bytes, *, is_ros1: bool = False
    ) -> None:
        order = '<' if is_ros1 else _ORDERS.get(bytes(example[:2]))
        if order is None:
            raise ValueError(f'encapsulation {bytes(example[:2]).hex()} is not plain CDR')
        self.type_name = type_name
        self.size = len(example)
        self.columns: dict[str, Column] = {}
        self.strings: dict[str, str | tuple[str, ...]] = {}
        self._fields = fields
        self._order = order
        self._is_ros1 = is_ros1
        self._example = bytes(example)
        self._position = 0 if is_ros1 else 4
        self._fixed = [] if is_ros1 else [slice(0, 2)]
        self._steps = 0
        try:
            self._walk(type_name, '')
        except struct.error as error:
            raise ValueError(f'cut off after {len(example)} bytes') from error
        except (RecursionError, KeyError) as error:
            raise ValueError(f'a type that cannot be read ({error})'[:200]) from None
        if self._position > len(example):
            raise ValueError(f'cut off after {len(example)} bytes')

    def matches(self, messages: Bytes) -> Bools:
        """Return a mask [N]: which of the messages [N, size] have this layout."""
        places, values = self._same
        return np.asarray((messages[:, places] == values).all(axis=1))

    @cached_property
    def _same(self) -> tuple[NDArray[np.intp], Bytes]:
        """Places of the bytes that all messages of the layout have alike, and these bytes."""
        places = np.concatenate([np.r_[part] for part in self._fixed] or [np.empty(0)])
        places = places.astype(np.intp)
        return places, np.frombuffer(self._example, np.uint8)[places]

    def decode(self, messages: Bytes, path: str) -> NDArray[Any]:
        """Return the numbers of a field of messages [N, size]: [N] or [N, count]."""
        column = self.columns[path]
        raw = np.ascontiguousarray(messages[:, column.offset : column.end])
        values = raw.view(column.dtype) if column.count != 0 else np.zeros((len(raw), 0))
        return values[:, 0] if column.count is None else values

    def encode(self, count: int, columns: Mapping[str, ArrayLike]) -> Bytes:
        """Return `count` copies of the example with new values by path, [count, size].

        Values are [count] or [count, length]. KeyError for an unknown path, ValueError for shapes.
        """
        block = np.tile(np.frombuffer(self._example, np.uint8), (count, 1))
        for path, values in columns.items():
            column = self.columns[path]
            shape = (count, 1 if column.count is None else column.count)
            array = np.asarray(values)
            if array.shape not in {shape, shape[: array.ndim]}:
                raise ValueError(f'{path} has shape {array.shape}; expected {shape}')
            numbers = np.ascontiguousarray(array.reshape(shape).astype(column.dtype))
            block[:, column.offset : column.end] = numbers.view(np.uint8)
        return block

    def _walk(self, type_name: str, prefix: str) -> None:
        for name, desc in self._fields[type_name][1]:
            self._steps += 1
            if self._steps > _MOST_FIELDS:
                raise ValueError(f'more than {_MOST_FIELDS} fields')
            self._field(f'{prefix}{name}', desc)

    def _field(self, path: str, desc: Any) -> None:
        kind, rest = desc
        if kind == Nodetype.NAME:
            self._walk(rest, f'{path}.')
        elif kind == Nodetype.BASE:
            if rest[0] == 'string':
                self.strings[path] = self._string()
            else:
                self._numbers(path, rest[0], None)
        else:
            (item_kind, item), count = rest
            if kind == Nodetype.SEQUENCE:
                count = self._length()
            if item_kind == Nodetype.NAME:
                if count > _MOST_FIELDS:
                    raise ValueError(f'more than {_MOST_FIELDS} fields')
                for i in range(count):
                    self._walk(item, f'{path}[{i}].')
            elif item[0] == 'string':
                self.strings[path] = tuple(self._string() for _ in range(count))
            else:
                self._numbers(path, item[0], count)

    def _numbers(self, path: str, kind: str, count: int | None) -> None:
        dtype = np.dtype(self._order + _DTYPES[kind])
        if count != 0:
            self._align(dtype.itemsize)
        column = Column(self._position, dtype, count)
        if column.end > self.size:
            raise ValueError(f'cut off after {self.size} bytes')
        self.columns[path] = column
        self._position = column.end

    def _length(self) -> int:
        self._align(4)
        (length,) = struct.unpack_from(f'{self._order}I', self._example, self._position)
        self._fix(4)
        if length > self.size:
            raise ValueError(f'an array of {length} in a message of {self.size} bytes')
        return int(length)

    def _string(self) -> str:
        length = self._length()
        if length > _LONGEST_TEXT:
            raise ValueError(f'a text of {length} bytes')
        start = self._position
        self._fix(length)
        text = self._example[start : start + length]
        return (text if self._is_ros1 else text[:-1]).decode('utf-8', 'replace')

    def _fix(self, size: int) -> None:
        start = self._position
        if self._fixed and self._fixed[-1].stop == start:
            start = self._fixed.pop().start
        self._position += size
        self._fixed.append(slice(start, self._position))

    def _align(self, size: int) -> None:
        if not self._is_ros1:
            self._position += -(self._position - 4) % size
