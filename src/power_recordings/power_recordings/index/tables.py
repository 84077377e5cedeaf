"""Tables of the index: recordings that fit a question, and Parquet files for other programs."""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from wattwalk_core.errors import InputError
from wattwalk_core.files import write_whole

from power_recordings.card import FILE, Card
from power_recordings.index.store import RecordingFacts, RecordingIndex, Stamp

_COLUMNS = (
    *('path', 'name', 'robot', 'unit', 'controller', 'terrain', 'created'),
    *('start', 'seconds', 'size', 'card'),
)
_FIGURES = ('model', 'drive', 'name', 'term', 'unit', 'value', 'error')
FILES = ('recordings.parquet', 'quality.parquet', 'coefficients.parquet')


def listed(
    index: RecordingIndex, robot: str, unit: str, since: str, until: str
) -> list[dict[str, Any]]:
    """Return rows of `recordings` by column, of a robot and unit, created in [since, until).

    Dates are ISO 8601; '' places no condition. Sorted by robot, unit and date.
    """
    asked = {
        'robot = ?': robot,
        'unit = ?': unit,
        'created >= ?': since,
        "created < ? AND created <> ''": until,
    }
    given = {condition: value for condition, value in asked.items() if value}
    rows = index.rows(
        f'SELECT {", ".join(_COLUMNS)} FROM recordings WHERE {" AND ".join(given) or "1"} '
        'ORDER BY robot, unit, created, start, path',
        list(given.values()),
    )
    return [dict(zip(_COLUMNS, row, strict=True)) for row in rows]


def recordings_below(folder: Path) -> Iterator[Path]:
    """Yield the bag folders in a folder, at any depth; InputError where there is no folder."""
    if not folder.is_dir():
        raise InputError(f'there is no folder {folder}')
    for where, folders, files in os.walk(folder):
        if 'metadata.yaml' in files or any(name.endswith('.mcap') for name in files):
            folders.clear()
            yield Path(where)
        else:
            folders.sort()


def add_cards(index: RecordingIndex, folders: Sequence[Path]) -> tuple[int, list[str]]:
    """Put the cards of all recordings in folders into the index.

    Returns the number of new or changed cards, and an error text for each one left out.
    """
    added, left_out = 0, []
    for folder in folders:
        for path in recordings_below(folder):
            try:
                stamp = Stamp.of(path)
                if index.knows(stamp):
                    continue
                card = Card.load(path) if (path / FILE).exists() else Card()
            except InputError as error:
                left_out.append(str(error))
                continue
            index.keep(stamp, RecordingFacts(card))
            added += 1
    return added, left_out


def export(index: RecordingIndex, folder: Path) -> None:
    """Write the index as the Parquet files `FILES` into a folder.

    InputError where pyarrow is not installed; RecordingError where a file cannot be written.
    """
    try:
        import pyarrow as pa  # may be absent
        from pyarrow import parquet
    except ImportError:
        raise InputError('--export needs pyarrow: pip install pyarrow') from None
    text, number, whole = pa.string(), pa.float64(), pa.int64()
    kinds = {'start': number, 'seconds': number, 'value': number, 'error': number}
    kinds |= {'size': whole, 'term': whole}
    of_recordings = f'SELECT {", ".join(_COLUMNS)} FROM recordings ORDER BY path'
    of_figures = (
        f'SELECT path, {", ".join(f"figures.{name}" for name in _FIGURES)} FROM figures '
        'JOIN recordings ON recording = id WHERE kind = ? ORDER BY path, figures.rowid'
    )
    tables = (
        (_COLUMNS, index.rows(of_recordings)),
        (('path', *_FIGURES), index.rows(of_figures, ('quality',))),
        (('path', *_FIGURES), index.rows(of_figures, ('fit',))),
    )
    folder.mkdir(parents=True, exist_ok=True)
    for file, (columns, rows) in zip(FILES, tables, strict=True):
        schema = pa.schema([(name, kinds.get(name, text)) for name in columns])
        content = [dict(zip(columns, row, strict=True)) for row in rows]
        sink = pa.BufferOutputStream()
        parquet.write_table(pa.Table.from_pylist(content, schema), sink)
        write_whole(folder / file, sink.getvalue().to_pybytes())
