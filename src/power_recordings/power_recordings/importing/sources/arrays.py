"""Named arrays as columns: what MAT, HDF5 and JSON files have in common."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.errors import InputError

from power_recordings.importing.sources.heads import unit_of
from power_recordings.importing.sources.source import (
    MOST_COLUMNS,
    LogBlock,
    LogColumn,
    Progress,
    rows_at_once,
)


class ArrayLog:
    """A log whose arrays are in memory."""

    is_bag = False

    def __init__(self, path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
        self.path = path
        self.size = path.stat().st_size
        self._arrays = arrays
        shapes = {name: array.shape for name, array in arrays.items()}
        self._columns = table_columns(str(path), shapes)

    def columns(self) -> Sequence[LogColumn]:
        """Return all columns."""
        return self._columns

    def read(self, addresses: Sequence[str], progress: Progress) -> Iterator[LogBlock]:
        """Yield rows, stream by stream."""
        wanted = set(addresses)
        for stream in dict.fromkeys(c.stream for c in self._columns if c.address in wanted):
            chosen = [c for c in self._columns if c.stream == stream and c.address in wanted]
            rows = {c.address: _column(self._arrays, c.address) for c in chosen}
            count = chosen[0].rows or 0
            step = rows_at_once(len(chosen))
            for start in range(0, count, step):
                progress(round(self.size * min(start + step, count) / count))
                yield LogBlock(stream, {a: r[start : start + step] for a, r in rows.items()})


def table_columns(where: str, shapes: Mapping[str, Sequence[int]]) -> list[LogColumn]:
    """
    Return the columns of named arrays by their shapes.

    An array [N] is one column, [N, K] or [K, N] are K columns `name.0` …; the longer axis is time.
    Arrays of one length share a stream. Scalars and higher dimensions are left out.
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
    """Return the name of the array and the index of the column that an address means."""
    if address in names:
        return address, 0
    name, _, index = address.rpartition('.')
    return name, int(index)


def as_rows(array: NDArray[Any]) -> NDArray[Any]:
    """Return an array with time along its first axis, [N, K]."""
    array = np.squeeze(array)
    if array.ndim == 1:
        return array[:, None]
    return array.T if array.shape[0] < array.shape[1] else array


def _column(arrays: Mapping[str, NDArray[Any]], address: str) -> NDArray[Any]:
    name, index = split(address, arrays)
    values = as_rows(arrays[name])[:, index]
    if values.dtype.kind in 'US':
        return values.astype(object)
    if values.dtype.kind == 'O':
        return values
    return values.astype(np.float64)
