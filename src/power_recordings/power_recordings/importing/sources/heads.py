"""Heads of tables: which row names the columns, which gives their units."""

import re
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.errors import InputError

from power_recordings.importing.sources.source import (
    MOST_COLUMNS,
    LogBlock,
    LogColumn,
    LogSource,
    Progress,
    rows_at_once,
)
from power_recordings.importing.units import is_unit

_NUMBER = re.compile(
    r'\s*[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?\s*|\s*[+-]?(nan|inf)\s*', re.I
)
THOUSANDS = {  # as they stand in a column, by the mark of decimals
    '.': r"[+-]?\d{1,3}([,']\d{3})+(\.\d+)?",
    ',': r"[+-]?\d{1,3}(['.]\d{3})+(,\d+)?",
}
_IN_GROUPS = re.compile('|'.join(THOUSANDS.values()))
_UNITS = re.compile(r'(?i)(units?|einheit(en)?)\s*[:=]\s*')
_DATE = re.compile(r'\d{2,4}[-./:]\d\d')
_NO_UNIT = ('-', '–', '%', '1')
_LIKE_A_HEAD = 0.5  # names to a value
_UNITS_THAT_ARE_NAMES = ('rpm', 'rps')
_WORDS = (  # that end names
    *('cycle', 'cycles', 'circle', 'turn', 'second', 'minute', 'min', 'day', 'hour', 'year'),
    *('a', 'd', 'h', 'r', 'qd'),
)
_TIMES = ('s', 'sec', 'ms', 'min')  # what a rate is over
_AFTER_DOTS = ('deg', 'rad', 'rpm', 'dps', 'Nm', 'mNm', 'mA', 'mV', 'mW', 'kW', 'degC')  # no names
_LENGTHS = ('m', 'cm', 'mm', 'km')  # of which a rate is no speed of a drive
_TIME = ('t', 'time', 'zeit')  # what is in `t/s`, where others are rates
_OVER_UNIT = re.compile(r'(?:[^:]*[_ .])?([^\W_]+)\s*/\s*([^/:\d][^/:]*)')
_COUNTS = re.compile(r'(?i)(.*[^a-z])?(n|w|.*(speed|vel|omega|drehzahl))')  # what 1_min is of
_FORCES = ('N', 'mN', 'cN', 'kN', 'kgf', 'ozf', 'lbf', 'oz', 'lb')
_NOTE = re.compile(r'\s\(')  # behind a unit, as in `deg (0..360)`
_ENDING = 200  # characters of a name that a unit is looked for in
_IN_BRACKETS = re.compile(r'\s*[\[(]\s*([^\[\]()]*?)\s*[\])]\s*$')


@dataclass(frozen=True)
class Head:
    """Names and units of the columns, and the index of the first row of values.

    unfit: number of names in the row above the values if it differs from that of values, else 0.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    first_row: int
    unfit: int = 0

    def check(self, path: Path) -> None:
        """Raise InputError if the head has not as many names as the rows have values."""
        if self.unfit:
            raise InputError(
                f'{path}: its head names {self.unfit} columns, its rows have {len(self.names)} '
                'values; mend the head'
            )


def is_number(field: str) -> bool:
    """Return whether a field is a number, NaN or infinity, with a point or a comma."""
    return bool(_NUMBER.fullmatch(field) or _IN_GROUPS.fullmatch(field.strip()))


def find_head(
    rows: Sequence[Sequence[str]],
    commented: Sequence[Sequence[str]] = (),
    spaced: Sequence[Sequence[str]] = (),
) -> Head | None:
    """Find the head of a table in its first rows (fields of each); None if no row holds numbers.

    Values begin with the first row of the usual width that holds at least half of the usual count
    of numbers. The row above names the columns; rows in between may hold units or dates.
    commented: the fields of comment lines above, the last of which may be the names, or units.
    spaced: the words of these, which may only repeat the names, with units.
    """
    widths = [len(row) for row in rows if row]
    if not widths:
        return None
    width = max(set(widths), key=lambda w: (widths.count(w), w))
    numbers = [sum(map(is_number, row)) if len(row) == width else 0 for row in rows]
    usual = sorted(n for n in numbers if n)
    if not usual:
        return None
    enough = usual[len(usual) // 2] / 2
    full = [i for i, count in enumerate(numbers) if count >= enough]
    first = full[0]
    for later in full[1:]:  # a row of numbers above a row of names is of a preamble
        if later > first + 1 and any(map(_is_name, rows[later - 1])):
            first = later
        else:
            break
    trailing = all(not row[-1].strip() for row in rows[first:] if len(row) == width)
    above = [fitted for row in rows[:first] if (fitted := _fitted(row, width, trailing))]
    notes = [fitted for row in commented if (fitted := _fitted(row, width, trailing))]
    notes = [[_UNITS.sub('', row[0]), *row[1:]] for row in notes]
    above = [*above, *filter(_all_units, notes)] if above else notes
    if not above and first == 0 and len(full) > 1:  # names may be numbers but for one
        pairs = zip(rows[0], rows[full[1]], strict=True)
        if any(_is_name(name) and is_number(value) for name, value in pairs):
            above, first = [list(rows[0])], full[1]
    units = [''] * width
    while len(above) > 1 and ((own := _all_units(above[-1])) or not any(map(_is_name, above[-1]))):
        row = above.pop()
        units = [_without_note(field).strip('[]()') for field in row] if own else units
    unfit = 0
    if not above and first and len(rows[first - 1]) >= max(2, _LIKE_A_HEAD * width):
        unfit = len(rows[first - 1])
    order = above[::-1] if above is notes else above  # a title may have as many parts
    fullest = max(order, key=lambda row: sum(map(_is_name, row)), default=None)
    names = fullest or [f'column{i}' for i in range(1, width + 1)]
    units = [unit_of(n) or (u if is_unit(u) else '') for n, u in zip(names, units, strict=True)]
    for note in (*notes, *spaced):
        if [_without_brackets(field) for field in note] == [n.strip() for n in names]:
            units = [unit or unit_of(field) for unit, field in zip(units, note, strict=True)]
    return Head(unique(names), tuple(units), first, unfit)


def _fitted(row: Sequence[str], width: int, trailing: bool) -> list[str] | None:
    """A row of names as wide as the values, whichever of the two ends in a delimiter."""
    fields = list(row)
    while len(fields) > width and not fields[-1].strip():
        fields.pop()
    if trailing and len(fields) == width - 1:
        fields.append('')
    return fields if len(fields) == width else None


def _is_name(field: str) -> bool:
    """Tell whether a field is no unit, number, date nor empty."""
    text = field.strip().strip('[]()')
    return bool(text) and not (
        is_unit(text) or is_number(text) or _DATE.match(text) or text in _NO_UNIT
    )


def unit_of(name: str) -> str:
    """Return the unit at the end of a name, in brackets or after `_`, `.`, ` ` or `/`; else ''."""
    name = name[-_ENDING:]
    found = _IN_BRACKETS.search(name)
    if found:
        return found[1] if is_unit(found[1]) else ''
    if (over := _OVER_UNIT.fullmatch(name)) is not None and is_unit(over[2]):
        of_rate = over[1] in _LENGTHS or (over[2] in _TIMES and over[1].lower() not in _TIME)
        if not of_rate and not is_unit(over[1]):
            return over[2]
    if (dotted := name.rpartition('.')[2]) != name and dotted in _AFTER_DOTS:
        return dotted
    *before, ending = re.split(r'[_ ]', name)
    if before and (both := _of_two_words(before, ending)) is not None:
        return both
    if ending in _WORDS or (not before and name.lower() not in _UNITS_THAT_ARE_NAMES):
        return ''
    return ending if len(ending) <= 6 and not ending.isdigit() and is_unit(ending) else ''


def _without_note(field: str) -> str:
    text = field.strip()
    return _NOTE.split(text, maxsplit=1)[0].rstrip() if text.endswith(')') else text


def _without_brackets(field: str) -> str:
    return (field[:-_ENDING] + _IN_BRACKETS.sub('', field[-_ENDING:])).strip()


def _of_two_words(before: Sequence[str], ending: str) -> str | None:
    """The unit that two words make, as rad_s and N_m; '' of none, None where one may be."""
    per = before[-1] == 'per'
    *rest, first = before[:-1] if per else before
    if first == '1' and ending in _TIMES and not _COUNTS.fullmatch('_'.join(rest)):
        return None
    if ending in _TIMES and is_unit(f'{first}/{ending}'):
        return f'{first}/{ending}'
    if first in _FORCES and is_unit(f'{first}*{ending}'):
        return f'{first}*{ending}'
    return '' if per or (ending in _TIMES and (first in _LENGTHS or is_unit(first))) else None


def unique(names: Sequence[str]) -> tuple[str, ...]:
    """Return stripped names; repeated ones get .1, .2 …, empty ones become `column<number>`."""
    seen: dict[str, int] = {}
    result = []
    for index, given in enumerate(names, 1):
        name = unicodedata.normalize('NFC', given.strip().lstrip('\ufeff')) or f'column{index}'
        count = seen.get(name, 0)
        seen[name] = count + 1
        result.append(f'{name}.{count}' if count else name)
    return tuple(result)


def _all_units(row: Sequence[str]) -> bool:
    fields = [
        text for field in row if (text := field.strip().strip('[]()')) not in ('', *_NO_UNIT)
    ]
    return bool(fields) and sum(map(is_unit, fields)) >= 0.5 * len(fields)


class ArrayLog(LogSource):
    """A log whose arrays are in memory."""

    def __init__(self, path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
        super().__init__(path)
        self._arrays = arrays
        shapes = {name: array.shape for name, array in arrays.items()}
        self._columns = table_columns(str(path), shapes)

    def columns(self) -> Sequence[LogColumn]:
        """Return all columns."""
        return self._columns

    def read(self, addresses: Sequence[str], progress: Progress) -> Iterator[LogBlock]:
        """Yield blocks of rows, stream by stream."""
        wanted = set(addresses)
        for stream in dict.fromkeys(c.stream for c in self._columns if c.address in wanted):
            chosen = [c for c in self._columns if c.stream == stream and c.address in wanted]
            count = chosen[0].rows or 0
            step = rows_at_once(len(chosen))
            for start in range(0, count, step):
                rows = slice(start, min(start + step, count))
                progress(round(self.size * rows.stop / count))
                yield LogBlock(stream, {c.address: self._values(c.address, rows) for c in chosen})

    def _values(self, address: str, rows: slice) -> NDArray[Any]:
        name, index = split(address, self._arrays)
        values = as_rows(self._arrays[name])[rows, index]
        if values.dtype.kind in 'US':
            return values.astype(object)
        return values if values.dtype.kind == 'O' else values.astype(np.float64)


def table_columns(where: str, shapes: Mapping[str, Sequence[int]]) -> list[LogColumn]:
    """Return the columns of named arrays by their shapes.

    An array [N] is one column, [N, K] or [K, N] are K columns `name.0` …; the longer axis is time.
    Arrays of one length share a stream. Scalars and higher dimensions are left out. InputError,
    which begins with `where`, for more than 20,000 columns.
    """
    found: list[LogColumn] = []
    for name, shape in shapes.items():
        rows = max(shape, default=0)
        if rows < 2 or len([n for n in shape if n > 1]) > 2:
            continue
        count = int(np.prod(shape, dtype=np.int64)) // rows
        if count * len(shape) > MOST_COLUMNS or len(found) + count > MOST_COLUMNS:
            raise InputError(f'{where}: more than {MOST_COLUMNS} columns')
        flat = sum(n > 1 for n in shape) < 2
        for i in range(count):
            address = name if flat else f'{name}.{i}'
            found.append(LogColumn(address, f'{rows} rows', unit_of(name), rows))
    return found


def split(address: str, names: Mapping[str, Any]) -> tuple[str, int]:
    """Split an address `name.index` into name and column; of one in `names` the column is 0."""
    if address in names:
        return address, 0
    name, _, index = address.rpartition('.')
    return name, int(index)


def as_rows(array: NDArray[Any]) -> NDArray[Any]:
    """Return an array as [N, K]; its longer axis is taken for time."""
    array = np.squeeze(array)
    if array.ndim == 1:
        return array[:, None]
    return array.T if array.shape[0] < array.shape[1] else array
