"""HDF5 files, MATLAB 7.3 among them, streamed with h5py."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError, printable

from power_recordings.importing.sources import heads
from power_recordings.importing.sources.source import (
    LogBlock,
    LogColumn,
    Progress,
    check_room,
    reading,
    rows_at_once,
)

_MOST_DATASETS: Final = 20_000


class Hdf5File:
    """Datasets as `group.dataset.column`; fields of compound types as `dataset.field`."""

    is_bag = False

    def __init__(self, path: Path) -> None:
        self.path = path
        self.size = path.stat().st_size
        self._fields: dict[str, tuple[str, str]] = {}  # address of an array: dataset, field
        shapes: dict[str, tuple[int, ...]] = {}
        claimed: list[int] = []  # bytes

        def visit(name: str, item: Any) -> None:
            if not isinstance(item, h5py.Dataset) or name.startswith('#refs#'):
                return
            if item.external or item.is_virtual:
                raise InputError(f'{path}: {printable(name, 80)} lies in another file')
            if len(shapes) >= _MOST_DATASETS:
                raise InputError(f'{path}: more than {_MOST_DATASETS} datasets')
            key = name.replace('/', '.')
            for field in item.dtype.names or ('',):
                if (item.dtype[field] if field else item.dtype).kind in 'fiub':
                    address = f'{key}.{field}' if field else key
                    self._fields[address] = (name, field)
                    shapes[address] = item.shape
                    claimed.append(math.prod(item.shape) * 8)

        with reading(path, 'HDF5 file'), h5py.File(path, 'r') as file:
            file.visititems(visit)
        check_room(path, self.size, sum(claimed))
        self._columns = heads.table_columns(str(path), shapes)

    def columns(self) -> Sequence[LogColumn]:
        """Return all columns."""
        return self._columns

    def read(self, addresses: Sequence[str], progress: Progress) -> Iterator[LogBlock]:
        """Yield rows, stream by stream, without loading whole datasets."""
        wanted = set(addresses)
        with reading(self.path, 'HDF5 file'), h5py.File(self.path, 'r') as file:
            for stream in dict.fromkeys(c.stream for c in self._columns if c.address in wanted):
                chosen = [c for c in self._columns if c.stream == stream and c.address in wanted]
                rows = chosen[0].rows or 0
                step = rows_at_once(len(chosen))
                for start in range(0, rows, step):
                    part = slice(start, min(start + step, rows))
                    progress(round(self.size * part.stop / rows))
                    values = {c.address: self._values(file, c.address, part) for c in chosen}
                    yield LogBlock(stream, values)

    def _values(self, file: Any, address: str, rows: slice) -> Floats:
        name, index = heads.split(address, self._fields)
        dataset, field = self._fields[name]
        data = file[dataset]
        axis = int(np.argmax(data.shape))
        place: list[Any] = [slice(None)] * data.ndim
        place[axis] = rows
        values = data[tuple(place)]
        values = np.moveaxis(values[field] if field else values, axis, 0)
        column = values.reshape(len(values), -1)[:, index]
        return np.asarray(column, np.float64)
