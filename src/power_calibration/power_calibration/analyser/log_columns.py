"""Columns of a delimited log as numbers; dates and times of day as seconds."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from power_recordings.importing.sources.delimited import DelimitedFile
from power_recordings.importing.sources.source import Progress, number
from power_recordings.importing.times import MISSING, moments
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError, quoted

_DATE = re.compile(r'(\d{4}-\d\d-\d\d|\d\d\.\d\d\.\d{4})[T ]\d\d:\d\d')
_DOTTED = re.compile(r'^(\d\d)\.(\d\d)\.(\d{4})')
_CLOCK = re.compile(r'\d{1,2}:\d\d:\d\d')


def read_columns(
    file: DelimitedFile, names: Sequence[str], progress: Progress
) -> tuple[Floats, tuple[str, ...]]:
    """Return the named columns, time first, [N, K], and notes on what was left out.

    Fields that are no numbers are NaN. Dates are s since 1970 in UTC (without a zone as if they
    were UTC), times of day s since midnight. InputError for a time in another form.
    """
    blocks = list(file.read(names, progress))
    columns = [
        np.concatenate([_numbers(block.values[name], file.path, is_time) for block in blocks])
        for name, is_time in zip(names, (True, *(False for _ in names[1:])), strict=True)
    ]
    rows = np.column_stack(columns)
    if any(_CLOCK.match(_sample(block.values[names[0]])) for block in blocks):
        rows[1:, 0] += 86_400 * np.cumsum(np.diff(rows[:, 0]) < -43_200)
    return rows, tuple(note for block in blocks for note in block.notes)


def _numbers(values: NDArray[np.generic], path: Path, is_time: bool) -> Floats:
    if values.dtype.kind != 'O' or not is_time:
        return number(values)
    sample = _sample(values)
    if _DATE.match(sample):
        # The day comes first, also beside a damaged date whose second number is above 12.
        texts = [_DOTTED.sub(r'\3-\2-\1', text or '') for text in values.tolist()]
        stamps = moments(np.array(texts, object), str(path), strict=False)
        return np.where(stamps > MISSING, stamps / 1e9, np.nan)
    if _CLOCK.match(sample):
        return _clocks(values.tolist())
    raise InputError(
        f'{path}: time {quoted(sample)} is not understood; expected seconds, ISO 8601 such as '
        '2025-06-15T14:00:00.000, DD.MM.YYYY HH:MM:SS or HH:MM:SS'
    )


def _sample(values: NDArray[np.generic]) -> str:
    """First text of a column, '' for one of numbers."""
    return next((text for text in values if text), '') if values.dtype.kind == 'O' else ''


def _clocks(texts: Sequence[str | None]) -> Floats:
    seconds = np.full(len(texts), np.nan)
    for row, text in enumerate(texts):
        try:
            hours, minutes, rest = (text or '').replace(',', '.').split(':')
            seconds[row] = 3600 * int(hours) + 60 * int(minutes) + float(rest)
        except ValueError:
            continue
    return seconds
