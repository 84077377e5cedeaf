"""Heads of tables: which row names the columns, which gives their units."""

import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass

from power_recordings.importing.units import is_unit

_NUMBER = re.compile(
    r'\s*[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?\s*|\s*[+-]?(nan|inf)\s*', re.I
)
_UNITS_THAT_ARE_NAMES = ('rpm', 'rps')
_IN_BRACKETS = re.compile(r'\s*[\[(]\s*([^\[\]()]*?)\s*[\])]\s*$')


@dataclass(frozen=True)
class Head:
    """Names and units of the columns, and the index of the first row of values."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    first_row: int


def is_number(field: str) -> bool:
    """Return whether a field is a number, NaN or infinity, with a point or a comma."""
    return bool(_NUMBER.fullmatch(field))


def find_head(
    rows: Sequence[Sequence[str]], commented: Sequence[Sequence[str]] = ()
) -> Head | None:
    """
    Find the head of a table in its first rows.

    The first row of values is the first of as many fields as most rows have that holds a number.
    The row above it names the columns; one in between may hold units. commented: the fields of
    comment lines above, the last of which may be the names. None where no row holds numbers.
    """
    widths = [len(row) for row in rows if row]
    if not widths:
        return None
    width = max(set(widths), key=lambda w: (widths.count(w), w))
    first = next((i for i, row in enumerate(rows) if _has_values(row, width)), None)
    if first is None:
        return None
    above = [list(row) for row in rows[:first] if len(row) == width]
    above = above or [list(row) for row in commented if len(row) == width]
    units = [''] * width
    if len(above) > 1 and _all_units(above[-1]):
        units = [field.strip().strip('[]()') for field in above.pop()]
    names = above[-1] if above else [f'column{i}' for i in range(1, width + 1)]
    units = [unit_of(n) or (u if is_unit(u) else '') for n, u in zip(names, units, strict=True)]
    return Head(unique(names), tuple(units), first)


def unit_of(name: str) -> str:
    """Return the unit in brackets or after `_` or a space that ends a name, or that it is."""
    found = _IN_BRACKETS.search(name)
    if found:
        return found[1] if is_unit(found[1]) else ''
    ending = re.split(r'[_ ]', name)[-1]
    if ending == name and name.lower() not in _UNITS_THAT_ARE_NAMES:
        return ''
    return ending if len(ending) <= 5 and not ending.isdigit() and is_unit(ending) else ''


def unique(names: Sequence[str]) -> tuple[str, ...]:
    """Return names without spaces around them; repeated ones get .1, .2 …, empty ones a number."""
    seen: dict[str, int] = {}
    result = []
    for index, given in enumerate(names, 1):
        name = unicodedata.normalize('NFC', given.strip().lstrip('\ufeff')) or f'column{index}'
        count = seen.get(name, 0)
        seen[name] = count + 1
        result.append(f'{name}.{count}' if count else name)
    return tuple(result)


def _has_values(row: Sequence[str], width: int) -> bool:
    return len(row) == width and any(is_number(field) for field in row)


def _all_units(row: Sequence[str]) -> bool:
    fields = [field.strip().strip('[]()') for field in row if field.strip().strip('[]()-')]
    return bool(fields) and sum(map(is_unit, fields)) >= 0.5 * len(fields)
