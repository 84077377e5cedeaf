"""JSON: lists by name, a list of records, or a record a line."""

import json
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.errors import InputError

from power_recordings.importing.sources.heads import ArrayLog
from power_recordings.importing.sources.source import MOST_COLUMNS, LogSource, number, reading

_LARGEST: Final = 32 << 20  # bytes; in memory they take twenty times as much
_MOST_CELLS: Final = 20_000_000
_DEEPEST: Final = 8


def open_file(path: Path) -> LogSource:
    """Open a JSON file; InputError for one that is damaged or too large."""
    if path.stat().st_size > _LARGEST:
        raise InputError(f'{path}: larger than {_LARGEST >> 20} MiB; convert it to CSV')
    found: dict[str, NDArray[Any]] = {}
    with reading(path, 'JSON file'):
        _collect('', _load(path), 0, found)
    return ArrayLog(path, found)


def _collect(prefix: str, content: Any, depth: int, found: dict[str, NDArray[Any]]) -> None:
    if depth > _DEEPEST:
        return
    if isinstance(content, list):
        content = _columns(content)
    if isinstance(content, np.ndarray):
        found[prefix.rstrip('.') or 'values'] = content
    elif isinstance(content, dict):
        for key, value in content.items():
            if isinstance(value, dict | list | np.ndarray):
                _collect(f'{prefix}{key}.', value, depth + 1, found)


def _load(path: Path) -> Any:
    text = path.read_text(encoding='utf-8-sig')
    if path.suffix.lower() in ('.jsonl', '.ndjson'):
        return [json.loads(line) for line in text.splitlines() if line.strip()]
    return json.loads(text)


def _columns(rows: list[Any]) -> dict[str, Any] | NDArray[Any] | None:
    """A list of records as columns, a list of numbers or of equal lists as an array."""
    if not rows:
        return None
    if all(isinstance(row, dict) for row in rows):
        keys = dict.fromkeys(key for row in rows for key in row)
        if len(keys) > MOST_COLUMNS or len(keys) * len(rows) > _MOST_CELLS:
            raise ValueError(f'{len(rows)} records of {len(keys)} keys; too many')
        columns = {key: [row.get(key) for row in rows] for key in keys}
        return {k: _of_records(values) for k, values in columns.items()}
    return _array(rows)


def _of_records(values: list[Any]) -> Any:
    first = next((v for v in values if v is not None), None)
    if isinstance(first, dict):
        return _columns([v if isinstance(v, dict) else {} for v in values])
    return _array(values)


def _array(rows: list[Any]) -> NDArray[Any] | None:
    lengths = {len(row) if isinstance(row, list) else None for row in rows}
    if lengths == {None}:
        texts = sum(isinstance(row, str) for row in rows)
        return np.array(rows, object).astype(str) if texts > len(rows) / 2 else number(rows)
    if len(lengths) == 1 and not any(isinstance(v, list | dict) for row in rows for v in row):
        return np.stack([number(row) for row in rows]) if rows[0] else None
    return None
