"""Spreadsheets (xlsx), streamed with openpyxl."""

from collections.abc import Iterator, Sequence
from datetime import date, datetime
from itertools import islice
from pathlib import Path
from typing import Any, Final
from zipfile import BadZipFile

import numpy as np
from wattwalk_core.errors import InputError
from wattwalk_core.quoting import printable

from power_recordings.importing.sources.heads import Head, find_head
from power_recordings.importing.sources.source import (
    MOST_COLUMNS,
    LogBlock,
    LogColumn,
    Progress,
    number,
)

_ROWS: Final = 4096
_HEAD: Final = 50
_UNPACKED: Final = 2 << 30  # bytes


def open_file(path: Path, messages: Path | None = None) -> 'Spreadsheet':
    """Open a workbook; InputError where no sheet holds rows of numbers."""
    return Spreadsheet(path)


class Spreadsheet:
    """The sheets of a workbook, one stream each; `Sheet.column` where there are several."""

    is_bag = False

    def __init__(self, path: Path) -> None:
        from openpyxl import load_workbook
        from openpyxl.utils.exceptions import InvalidFileException

        self.path = path
        self.size = path.stat().st_size
        try:
            _check_size(path)
            self._book = load_workbook(path, read_only=True, data_only=True)
            self._heads = {s.title: h for s in self._book.worksheets if (h := _head(s))}
        except (BadZipFile, InvalidFileException, KeyError, ValueError, OSError) as error:
            raise InputError(f'{path}: not a readable workbook: {printable(str(error))}') from None
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
        """Yield rows, sheet by sheet."""
        for sheet, head in self._heads.items():
            places = {
                address: i
                for i, name in enumerate(head.names)
                if (address := self._address(sheet, name)) in addresses
            }
            if not places:
                continue
            rows = self._book[sheet].iter_rows(min_row=head.first_row + 1, values_only=True)
            done = 0
            while some := list(islice(rows, _ROWS)):
                done += len(some)
                progress(min(self.size, done * 8 * len(head.names)))
                columns = {a: _column([_cell(row, i) for row in some]) for a, i in places.items()}
                yield LogBlock(sheet, columns)


def _check_size(path: Path) -> None:
    from zipfile import ZipFile

    with ZipFile(path) as archive:
        size = sum(entry.file_size for entry in archive.infolist())
    if size > _UNPACKED:
        raise InputError(
            f'{path}: unpacks to {size >> 20} MiB; at most {_UNPACKED >> 20} are read'
        )


def _head(sheet: Any) -> Head | None:
    rows = [
        ['' if cell is None else str(cell) for cell in row[: MOST_COLUMNS + 1]]
        for row in sheet.iter_rows(max_row=_HEAD, values_only=True)
    ]
    return find_head(rows)


def _cell(row: Sequence[Any], index: int) -> Any:
    value = row[index] if index < len(row) else None
    return value.isoformat() if isinstance(value, date | datetime) else value


def _column(cells: Sequence[Any]) -> np.ndarray:
    texts = [isinstance(cell, str) for cell in cells]
    if sum(texts) > 0.5 * len(texts):
        return np.array(['' if cell is None else str(cell) for cell in cells], object)
    return number(np.array(cells, object))
