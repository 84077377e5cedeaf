"""Reads the numbers of a CSV log of any dialect, block by block."""

import csv
import io
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.errors import InputError

Floats = NDArray[np.float64]
_HEAD = 64 << 10  # bytes looked at to find the dialect
_BLOCK = 8 << 20
_DELIMITERS = (';', '\t', ',', ' ')
_NUMBER = re.compile(r'[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?|[+-]?(nan|inf)', re.I)
_DATE = re.compile(r'\d{4}-\d\d-\d\d[T ]\d\d:\d\d')
_DOTTED = re.compile(r'(\d\d)\.(\d\d)\.(\d{4})[T ](\d\d:\d\d.*)')
_CLOCK = re.compile(r'\d{1,2}:\d\d:\d\d')
_ZONE = re.compile(r' ?(Z|UTC|[+-]\d\d:?\d\d)$')


@dataclass(frozen=True)
class Dialect:
    """Dialect of a log: separator of fields, decimal mark, first row of numbers."""

    delimiter: str
    comma: bool  # decimals after a comma
    names: tuple[str, ...]  # of the columns; empty without a header
    skip: int  # bytes before the first row
    fields: tuple[str, ...]  # of the first row

    @classmethod
    def sniff(cls, path: Path) -> 'Dialect':
        """Look at the head of a file; InputError if no rows of numbers are found in it."""
        with path.open('rb') as file:
            head = file.read(_HEAD)
        whole = head if len(head) < _HEAD else head[: head.rfind(b'\n') + 1]
        lines = whole.decode('utf-8-sig', 'replace').splitlines()
        for delimiter in _DELIMITERS:
            found = _rows(lines, delimiter)
            if found is None:
                continue
            first, width = found
            fields = _split(lines[first], delimiter)
            names: tuple[str, ...] = ()
            above = [line for line in lines[:first] if line.strip()]
            if above and len(_split(above[-1].lstrip('#'), delimiter)) == width:
                names = tuple(_split(above[-1].lstrip('#'), delimiter))
            comma = delimiter != ',' and any(',' in field for field in fields)
            skip = _offset(whole, first)
            return cls(delimiter, comma, names, skip, tuple(fields))
        raise InputError(
            f'{path}: no rows of numbers found in it; expected a CSV file with time, voltage, '
            'current or power'
        )


def _split(line: str, delimiter: str) -> list[str]:
    if delimiter == ' ':
        return line.split()
    return [field.strip() for field in next(csv.reader([line], delimiter=delimiter), [])]


def _rows(lines: Sequence[str], delimiter: str) -> tuple[int, int] | None:
    """First row of the table and its number of fields, if this delimiter makes one."""
    for first, line in enumerate(lines):
        fields = _split(line, delimiter)
        if len(fields) < 2 or not all(_plain(field) for field in fields):
            continue
        if sum(bool(_NUMBER.fullmatch(field)) for field in fields) < len(fields) - 1:
            continue
        follow = [_split(other, delimiter) for other in lines[first + 1 : first + 4]]
        if all(len(other) == len(fields) for other in follow):
            return first, len(fields)
    return None


def _plain(field: str) -> bool:
    """True for a number, a time, or an empty field."""
    return (
        not field
        or any(pattern.match(field) for pattern in (_DATE, _DOTTED, _CLOCK))
        or bool(_NUMBER.fullmatch(field))
    )


def _offset(head: bytes, line: int) -> int:
    place = 0
    for _ in range(line):
        place = head.index(b'\n', place) + 1
    return place


def blocks(path: Path, dialect: Dialect, progress: Callable[[int], None]) -> Iterator[bytes]:
    """Whole lines of the rows, about 8 MiB at a time; progress is told the bytes read."""
    with path.open('rb') as file:
        file.seek(dialect.skip)
        rest = b''
        while chunk := file.read(_BLOCK):
            progress(len(chunk))
            cut = chunk.rfind(b'\n') + 1
            if not cut:
                rest += chunk
                continue
            yield rest + chunk[:cut]
            rest = chunk[cut:]
        if rest.strip():
            yield rest


def read_columns(
    path: Path, dialect: Dialect, wanted: Sequence[int], progress: Callable[[int], None]
) -> tuple[Floats, int]:
    """
    The wanted columns, the first of which is time: [N, K], and how many fields were no number.

    What is empty, `OL` or cut off is NaN. Dates are s since 1970 in UTC (without a zone as if
    they were UTC), times of day s since midnight.
    """
    parts: list[Floats] = []
    bad = 0
    time = _time_reader(path, dialect.fields[wanted[0]])
    for block in blocks(path, dialect, progress):
        text = block.replace(b',', b'.') if dialect.comma else block
        delimiter = None if dialect.delimiter == ' ' else dialect.delimiter
        if time is None:
            try:
                parts.append(
                    np.loadtxt(
                        io.BytesIO(text), delimiter=delimiter, usecols=list(wanted), ndmin=2
                    )
                )
                continue
            except ValueError:
                pass
        rows, wrong = _slow(block, dialect, wanted, time)
        parts.append(rows)
        bad += wrong
    rows = np.concatenate(parts) if parts else np.zeros((0, len(wanted)))
    if time is _clocks:
        rows[1:, 0] += 86_400 * np.cumsum(np.diff(rows[:, 0]) < -43_200)
    return rows, bad


def _slow(
    block: bytes,
    dialect: Dialect,
    wanted: Sequence[int],
    time: Callable[[list[str]], Floats] | None,
) -> tuple[Floats, int]:
    """The same for a block with fields that are no numbers."""
    width = max(wanted) + 1
    text = block.decode('utf-8', 'replace')
    lines = [fields for line in text.splitlines() if (fields := line.strip())]
    if dialect.delimiter == ' ':
        table = [line.split() for line in lines]
    else:
        table = list(csv.reader(lines, delimiter=dialect.delimiter))
    table = [fields + [''] * (width - len(fields)) for fields in table]
    columns = [[fields[index] for fields in table] for index in wanted]
    first = _numbers(columns[0], dialect.comma) if time is None else time(columns[0])
    rest = [_numbers(column, dialect.comma) for column in columns[1:]]
    rows = np.column_stack([first, *rest])
    return rows, int(np.isnan(rows).sum())


def _numbers(texts: Sequence[str], comma: bool) -> Floats:
    clean = [text.replace(',', '.') for text in texts] if comma else list(texts)
    try:
        return np.array(clean, dtype=np.float64)
    except ValueError:
        return np.array([_number(text) for text in clean])


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return np.nan


def _time_reader(path: Path, sample: str) -> Callable[[list[str]], Floats] | None:
    """Return the reader of a column of dates or times of day, in s; None for plain numbers."""
    if _DATE.match(sample) or _DOTTED.match(sample):
        return _dates
    if _CLOCK.match(sample):
        return _clocks
    if not _NUMBER.fullmatch(sample):
        raise InputError(
            f'{path}: time {sample!r} is not understood; expected seconds, ISO 8601 such as '
            '2025-06-15T14:00:00.000, DD.MM.YYYY HH:MM:SS or HH:MM:SS'
        )
    return None


def _dates(texts: list[str]) -> Floats:
    texts = [_iso(text) for text in texts]
    zone = _ZONE.search(texts[0]) if texts else None
    shift = 0.0
    if zone is not None:
        moved = datetime.fromisoformat(f'2000-01-01T00:00:00{zone[1].replace("UTC", "Z")}')
        offset = moved.utcoffset()
        shift = offset.total_seconds() if offset is not None else 0.0
        texts = [_ZONE.sub('', text) for text in texts]
    try:
        stamps = np.array(texts, dtype='datetime64[ns]')
    except ValueError:
        stamps = np.array([_date(text) for text in texts], dtype='datetime64[ns]')
    seconds = stamps.astype(np.int64) / 1e9 - shift
    seconds[np.isnat(stamps)] = np.nan
    return seconds


def _iso(text: str) -> str:
    text = text.strip().replace(',', '.')
    dotted = _DOTTED.match(text)
    return f'{dotted[3]}-{dotted[2]}-{dotted[1]}T{dotted[4]}' if dotted else text


def _date(text: str) -> np.datetime64:
    try:
        return np.datetime64(text, 'ns')
    except ValueError:
        return np.datetime64('NaT')


def _clocks(texts: list[str]) -> Floats:
    seconds = np.full(len(texts), np.nan)
    for row, text in enumerate(texts):
        try:
            hours, minutes, rest = text.replace(',', '.').split(':')
            seconds[row] = 3600 * int(hours) + 60 * int(minutes) + float(rest)
        except ValueError:
            continue
    return seconds
