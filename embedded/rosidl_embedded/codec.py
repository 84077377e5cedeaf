"""CDR: message objects to bytes and back, by the functions that rosbags generates."""

import struct
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import FieldDesc
from rosbags.serde import SerdeError
from rosbags.typesys.store import Typestore

from rosidl_embedded.message import Message, class_of

LITTLE_ENDIAN = b'\x00\x01\x00\x00'

_store = Typestore()
_functions: dict[type[Message], Any] = {}


def _nested(desc: FieldDesc) -> str | None:
    if desc[0] in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        return _nested(desc[1][0])
    return str(desc[1]) if desc[0] == Nodetype.NAME else None


def _register(cls: Any) -> Any:
    """Generate the CDR functions of a message and of all that is nested in it."""
    if cls in _functions:
        return _functions[cls]
    for _, desc in cls._wire_fields:
        if (inner := _nested(desc)) is not None:
            _register(class_of(inner))
    _store.fielddefs[cls._type_name] = ([], cls._wire_fields)
    _store.types[cls._type_name] = cls._from_wire
    _functions[cls] = _store.get_msgdef(cls._type_name)
    return _functions[cls]


def serialize(message: Message, prefix: bytes = b'') -> bytes:
    """Return the little-endian XCDR1 bytes of a message.

    A prefix of a multiple of eight bytes goes between the encapsulation and the message.
    Raises TypeError where a field holds what its type cannot.
    """
    functions = _functions.get(message.__class__) or _register(message.__class__)
    start = 4 + len(prefix)
    try:
        buffer = bytearray(start + functions.getsize_cdr(0, message, _store))
        buffer[:start] = LITTLE_ENDIAN + prefix
        functions.serialize_cdr_le(memoryview(buffer)[start:], 0, message, _store)
    except (struct.error, AttributeError, TypeError, ValueError, SerdeError) as error:
        raise TypeError(f'cannot serialize {message!r}: {error}') from error
    return bytes(buffer)


def deserialize(data: bytes, cls: type[Message], skip: int = 0) -> Any:
    """Decode CDR bytes to a message of class `cls`, ignoring `skip` bytes after the encapsulation.

    Raises ValueError where the bytes are no such message.
    """
    functions = _functions.get(cls) or _register(cls)
    if len(data) < 4 or data[0] != 0 or data[1] > 1:
        raise ValueError(f'no CDR of {cls._type_name}: {data[:4].hex()}')
    read = functions.deserialize_cdr_le if data[1] else functions.deserialize_cdr_be
    try:
        return read(data[4 + skip :], 0, functions.cls, _store)[0]
    except (struct.error, ValueError, SerdeError) as error:
        raise ValueError(f'no CDR of {cls._type_name}: {error}') from error


def warm(cls: type[Message]) -> None:
    """Generate the code of a message now and not when the first one comes."""
    serialize(cls())
