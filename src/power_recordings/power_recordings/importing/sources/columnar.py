"""Parquet and Feather (Arrow) files, streamed with pyarrow."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import compute as pc
from pyarrow import parquet
from wattwalk_core.errors import InputError

from power_recordings.importing.sources.heads import unit_of
from power_recordings.importing.sources.source import (
    MOST_COLUMNS,
    LogBlock,
    LogColumn,
    LogSource,
    Progress,
    check_room,
    reading,
    rows_at_once,
)


class ColumnarFile(LogSource):
    """A table of columns, all in one stream; elements of fixed lists are `column.index`."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._is_parquet = path.suffix.lower() in ('.parquet', '.pq')
        self._rows: int | None = None
        with reading(path, 'table'):
            if self._is_parquet:
                file = parquet.ParquetFile(path)
                self._schema, self._rows = file.schema_arrow, file.metadata.num_rows
            else:
                self._schema = self._feather(None).schema
        count = len(self._schema.names)
        if count > MOST_COLUMNS:
            raise InputError(f'{path}: {count} columns; at most {MOST_COLUMNS} are read')
        check_room(path, self.size, (self._rows or 0) * count * 8)

    def _feather(self, columns: list[int] | None) -> Any:
        options = pa.ipc.IpcReadOptions(included_fields=columns)
        return pa.ipc.open_file(pa.memory_map(str(self.path)), options=options)

    def _batches(self, names: list[str]) -> Iterator[Any]:
        if self._is_parquet:
            file = parquet.ParquetFile(self.path)
            yield from file.iter_batches(rows_at_once(len(names)), columns=names)
            return
        reader = self._feather([self._schema.get_field_index(name) for name in names])
        for i in range(reader.num_record_batches):
            batch, step = reader.get_batch(i), rows_at_once(len(names))
            for start in range(0, batch.num_rows, step):
                yield batch.slice(start, step)

    def columns(self) -> Sequence[LogColumn]:
        """Return the columns of numbers, and of texts and times that may be dates."""
        found = []
        for field in self._schema:
            kind = field.type
            if pa.types.is_fixed_size_list(kind) and kind.list_size <= MOST_COLUMNS:
                unit, names = unit_of(field.name), range(kind.list_size)
                found += [LogColumn(f'{field.name}.{i}', '', unit, self._rows) for i in names]
            elif not pa.types.is_nested(kind):
                found.append(LogColumn(field.name, '', unit_of(field.name), self._rows))
        return found

    def read(self, addresses: Sequence[str], progress: Progress) -> Iterator[LogBlock]:
        """Yield blocks of rows; as of `LogSource.read`."""
        fields = {a: self._field(a) for a in addresses}
        names = list(dict.fromkeys(name for name, _ in fields.values()))
        done = 0
        with reading(self.path, 'table'):
            for batch in self._batches(names):
                done += batch.num_rows
                check_room(self.path, self.size, done * 8)
                progress(round(self.size * done / max(self._rows or 0, done, 1)))
                yield LogBlock(
                    '', {a: _values(batch.column(n), i) for a, (n, i) in fields.items()}
                )

    def _field(self, address: str) -> tuple[str, int | None]:
        if address in self._schema.names:
            return address, None
        name, _, index = address.rpartition('.')
        return name, int(index)


def _values(column: Any, index: int | None) -> np.ndarray:
    if index is not None:
        column = pc.list_element(column, index)
    if pa.types.is_timestamp(column.type):
        stamps = column.cast(pa.timestamp('ns')).to_numpy(zero_copy_only=False)
        return np.asarray(stamps.astype('datetime64[ns]').astype(np.int64) / 1e9)
    if pa.types.is_duration(column.type):
        return np.asarray(column.cast(pa.duration('ns')).to_numpy(False).astype(np.int64) / 1e9)
    if pa.types.is_boolean(column.type):
        column = column.cast(pa.int8())
    if pa.types.is_integer(column.type) or pa.types.is_floating(column.type):
        return np.asarray(column.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False))
    return np.asarray(column.cast(pa.string()).to_numpy(zero_copy_only=False))
