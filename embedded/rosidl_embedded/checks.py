"""The field checks that ROS_PYTHON_CHECK_FIELDS=1 turns on."""

import re
from array import array
from typing import Any

import numpy as np

INTEGER = re.compile(r'(u?)int(8|16|32|64)')
SEQUENCE = re.compile(r'sequence<(.+?)(?:, (\d+))?>|(.+)\[(\d+)\]')


def _single(name: str, idl: str, value: Any) -> None:
    if match := INTEGER.fullmatch(idl):
        bits = int(match[2])
        low, high = (0, 2**bits) if match[1] else (-(2 ** (bits - 1)), 2 ** (bits - 1))
        assert isinstance(value, int | np.integer), f"The '{name}' field must be of type 'int'"
        assert low <= value < high, f"The '{name}' field must be an integer in [{low}, {high - 1}]"
    elif idl in ('float', 'double'):
        assert isinstance(value, float), f"The '{name}' field must be of type 'float'"
    elif idl == 'boolean':
        assert isinstance(value, bool), f"The '{name}' field must be of type 'bool'"
    elif idl == 'octet':
        assert isinstance(value, bytes), f"The '{name}' field must be of type 'bytes'"
        assert len(value) == 1, f"The '{name}' field must be of length 1"
    elif idl.startswith('string'):
        assert isinstance(value, str), f"The '{name}' field must be of type 'str'"
    elif '/' in idl:
        found = getattr(value, '_type_name', '').replace('/msg/', '/')
        assert found == idl, f"The '{name}' field must be a sub message of type '{idl}'"


def check(name: str, idl: str, value: Any) -> None:
    """Raise AssertionError, in rosidl's words, where a value does not fit a field's IDL type."""
    match = SEQUENCE.fullmatch(idl)
    if match is None:
        _single(name, idl, value)
        return
    inner, limit, count = match[1] or match[3], match[2], match[4]
    assert isinstance(value, list | tuple | set | array | np.ndarray), (
        f"The '{name}' field must be a set or sequence"
    )
    assert limit is None or len(value) <= int(limit), (
        f"The '{name}' field must be a set or sequence with length <= {limit}"
    )
    assert count is None or len(value) == int(count), (
        f"The '{name}' field must be a set or sequence with length {count}"
    )
    for item in value:
        _single(name, inner, item)
