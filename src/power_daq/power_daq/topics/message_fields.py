"""Numbers in messages of any type, by the addresses of import maps."""

import re
from collections.abc import Iterator, Sequence
from math import nan
from typing import Any

from power_recordings.importing.sources.source import LogColumn

_MOST_COLUMNS = 400
_STEP = re.compile(r'\.?([^.\[\]]+)(?:\[([^\[\]]*)\])?')


class MessageField:
    """
    One number of a message: `field.path`, `array[3]`, `array[NAME]` or `array[3].field`.

    A name is looked up in the field `name` beside the array, as in sensor_msgs/JointState.
    """

    def __init__(self, path: str) -> None:
        self._steps = [(m[1], m[2]) for m in _STEP.finditer(path)]

    def read(self, message: Any) -> float:
        """Return the number; NaN where the message has none there."""
        for name, index in self._steps:
            parent, message = message, getattr(message, name, None)
            if index is not None:
                place = _place(parent, message, index)
                if place is None:
                    return nan
                message = message[place]
        return float(message) if isinstance(message, int | float) else nan


def _place(parent: Any, values: Any, index: str) -> int | None:
    """Return the place of an index or name in an array, None where it is not there."""
    if isinstance(values, str) or not hasattr(values, '__len__'):
        return None
    names = _names(parent, len(values))
    if index in names:
        return names.index(index)
    return int(index) if index.isdecimal() and int(index) < len(values) else None


def _names(parent: Any, count: int) -> Sequence[str]:
    """Return the names of an array's values, those of the field `name` beside it."""
    names = getattr(parent, 'name', ())
    is_named = isinstance(names, list | tuple) and len(names) == len(set(names)) == count
    return names if is_named and all(isinstance(name, str) for name in names) else ()


def columns_of(topic: str, message: Any) -> list[LogColumn]:
    """Return the numbers of a message as columns, at most 400."""
    found = []
    for path in _paths(message, ''):
        found.append(LogColumn(f'{topic}:{path}', topic))
        if len(found) == _MOST_COLUMNS:
            break
    return found


def _paths(message: Any, prefix: str) -> Iterator[str]:
    for field in message.get_fields_and_field_types():
        value, path = getattr(message, field), f'{prefix}{field}'
        if isinstance(value, int | float):
            yield path
        elif hasattr(value, 'get_fields_and_field_types'):
            yield from () if path == 'header' else _paths(value, f'{path}.')
        elif not isinstance(value, str | bytes) and len(value):
            names = _names(message, len(value)) or range(len(value))
            if hasattr(value[0], 'get_fields_and_field_types'):
                for index, item in enumerate(value):
                    yield from _paths(item, f'{path}[{index}].')
            elif isinstance(value[0], int | float):
                yield from (f'{path}[{name}]' for name in names)
