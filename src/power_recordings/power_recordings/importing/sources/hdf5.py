"""HDF5 files, MATLAB 7.3 among them, streamed with h5py."""

import math
from collections.abc import Iterator, Sequence
from copy import copy
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError, printable

from power_recordings.importing.sources import heads
from power_recordings.importing.sources.source import LogBlock, Progress, check_room, reading

_MOST_DATASETS: Final = 20_000


class Hdf5File(heads.ArrayLog):
    """Datasets as `group.dataset.column`; fields of compound types as `dataset.field`.

    They stay in the file until their rows are read.
    """

    _file: h5py.File  # of a reader

    def __init__(self, path: Path) -> None:
        super().__init__(path, {})
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

    def read(self, addresses: Sequence[str], progress: Progress) -> Iterator[LogBlock]:
        """Yield blocks of rows, stream by stream; whole datasets are not loaded."""
        own = copy(self)  # each reader has its file
        with reading(self.path, 'HDF5 file'), h5py.File(self.path, 'r') as own._file:
            yield from heads.ArrayLog.read(own, addresses, progress)

    def _values(self, address: str, rows: slice) -> Floats:
        name, index = heads.split(address, self._fields)
        dataset, field = self._fields[name]
        data = self._file[dataset]
        axis = int(np.argmax(data.shape))
        place: list[Any] = [slice(None)] * data.ndim
        place[axis] = rows
        values = data[tuple(place)]
        values = np.moveaxis(values[field] if field else values, axis, 0)
        column = values.reshape(len(values), -1)[:, index]
        return np.asarray(column, np.float64)
