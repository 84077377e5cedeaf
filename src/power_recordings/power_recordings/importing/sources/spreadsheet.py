"""Spreadsheets (xlsx), streamed with openpyxl."""

from collections.abc import Iterator, Sequence
from datetime import date, datetime, time
from itertools import islice
from pathlib import Path
from typing import Any, Final
from warnings import catch_warnings
from zipfile import ZipFile

import numpy as np
from openpyxl import load_workbook
from wattwalk_core.errors import InputError

from power_recordings.importing.sources.heads import Head, find_head
from power_recordings.importing.sources.source import (
    MOST_COLUMNS,
    LogBlock,
    LogColumn,
    LogSource,
    Progress,
    number,
    reading,
    rows_at_once,
)

_HEAD: Final = 50
_MOST_ROWS: Final = 1 << 20
_MOST_EMPTY: Final = 10_000  # rows in a row
_ROOM: Final = 16 << 20  # bytes that a workbook may unpack to, and times its own size
_RATIO: Final = 50


class Spreadsheet(LogSource):
    """The sheets of a workbook, one stream each; `Sheet.column` where there are several."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        with reading(path, 'workbook'), catch_warnings(action='ignore'):
            with ZipFile(path) as archive:
                size = sum(entry.file_size for entry in archive.infolist())
            if size > _ROOM + _RATIO * self.size:
                raise InputError(
                    f'{path}: unpacks to {size >> 20} MiB, far more than a workbook does'
                )
            self._book = load_workbook(path, read_only=True, data_only=True, keep_links=False)
            self._heads = {s.title: h for s in self._book.worksheets if (h := _head(s))}
            for head in self._heads.values():
                head.check(path)
        if not self._heads:
            raise InputError(f'{path}: no sheet with rows of numbers found')

    def columns(self) -> Sequence[LogColumn]:
        """Return the columns of all sheets."""
        return [
            LogColumn(self._address(sheet, name), sheet, unit)
            for sheet, head in self._heads.items()
            for name, unit in zip(head.names, head.units, strict=True)
        ]

    def _address(self, sheet: str, name: str) -> str:
        return name if len(self._heads) == 1 else f'{sheet}.{name}'

    def read(self, addresses: Sequence[str], progress: Progress) -> Iterator[LogBlock]:
        """Yield blocks of rows, sheet by sheet."""
        for sheet, head in self._heads.items():
            places = {
                address: i
                for i, name in enumerate(head.names)
                if (address := self._address(sheet, name)) in addresses
            }
            if not places:
                continue
            rows = islice(_rows(self._book[sheet]), head.first_row, None)
            done = 0
            with reading(self.path, 'workbook'):
                while some := list(islice(rows, rows_at_once(16 * len(places)))):
                    done += len(some)
                    progress(min(self.size, done * 8 * len(head.names)))
                    yield LogBlock(
                        sheet,
                        {a: _column([_cell(row, i) for row in some]) for a, i in places.items()},
                    )


def _rows(sheet: Any) -> Iterator[Sequence[Any]]:
    """Yield the rows of a sheet, whatever size it claims to have."""
    sheet.reset_dimensions()
    empty = 0
    for row in islice(sheet.iter_rows(values_only=True), _MOST_ROWS):
        empty = 0 if row else empty + 1
        if empty > _MOST_EMPTY:
            return
        yield row


def _head(sheet: Any) -> Head | None:
    rows = [
        ['' if cell is None else str(cell) for cell in row[: MOST_COLUMNS + 1]]
        for row in islice(_rows(sheet), _HEAD)
    ]
    width = max(map(len, rows), default=0)
    return find_head([row + [''] * (width - len(row)) for row in rows])


def _cell(row: Sequence[Any], index: int) -> Any:
    value = row[index] if index < len(row) else None
    return value.isoformat() if isinstance(value, date | datetime | time) else value


def _column(cells: Sequence[Any]) -> np.ndarray:
    texts = [isinstance(cell, str) for cell in cells]
    if sum(texts) > 0.5 * len(texts):
        return np.array(['' if cell is None else str(cell) for cell in cells], object)
    return number(np.array(cells, object))
