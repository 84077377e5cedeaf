"""Fields of message types, from the definitions that bags hold."""

import re
from collections.abc import Mapping
from functools import lru_cache
from typing import Any, Final

from rosbags.typesys import TypesysError, get_types_from_idl, get_types_from_msg

from power_recordings.messages.cdr import typestore

_LARGEST: Final = 128 << 10  # bytes of a definition without blank lines
_BLANK = re.compile(r'(\r?\n)[ \t\r\n]+')
_SEPARATOR: Final = '=' * 80 + '\n'

Fields = Mapping[str, Any]


@lru_cache(64)
def own_fields(text: str, type_name: str) -> Fields:
    """Return the fields by type of a definition: ROS 1 or 2 messages, or IDL as rosbag2 writes it.

    Raises ValueError for a text that is not one, or too long.
    """
    text = _BLANK.sub(r'\1', text)
    if len(text) > _LARGEST:
        raise ValueError(f'{len(text) >> 10} KiB; at most {_LARGEST >> 10} are read')
    try:
        if text.startswith(f'{_SEPARATOR}IDL: '):
            parts = [part.split('\n', 1)[-1] for part in text.split(_SEPARATOR)[1:]]
            return {k: v for part in parts for k, v in get_types_from_idl(part).items()}
        return dict(get_types_from_msg(text, type_name))
    except (TypesysError, KeyError, RecursionError) as error:
        raise ValueError(str(error)) from None


def fields_of(text: str, type_name: str, given: Fields) -> Fields:
    """Return the fields of all types that a message may need.

    The bag's definition comes first, then `given`, then ROS 2 Jazzy's and this suite's.
    """
    own = own_fields(text, type_name) if text else {}
    return {**typestore().fielddefs, **given, **own}
