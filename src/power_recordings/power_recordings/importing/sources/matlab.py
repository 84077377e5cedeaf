"""MAT files: up to version 7.2 with scipy, 7.3 as the HDF5 files that they are."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.errors import InputError
from wattwalk_core.quoting import printable

from power_recordings.importing.sources import arrays
from power_recordings.importing.sources.source import (
    LogBlock,
    LogColumn,
    LogSource,
    Progress,
    reading,
)

_LARGEST: Final = 1 << 27  # numbers of one variable
_DEEPEST: Final = 8


def open_file(path: Path, messages: Path | None = None) -> LogSource:
    """Open a MAT file; InputError for one that is damaged."""
    with path.open('rb') as file:
        head = file.read(128)
    if head[:4] == b'\x89HDF' or b'MATLAB 7.3' in head:
        from power_recordings.importing.sources import check_library
        from power_recordings.importing.sources.hdf5 import Hdf5File

        check_library('hdf5', path)
        return Hdf5File(path)
    return MatFile(path)


class MatFile:
    """Variables and fields of structs as `struct.field.column`."""

    is_bag = False

    def __init__(self, path: Path) -> None:
        from scipy.io import loadmat, whosmat

        self.path = path
        self.size = path.stat().st_size
        with reading(path, 'MAT file'):
            for name, shape, _ in whosmat(path):
                if min(shape, default=0) < 0 or math.prod(shape) > _LARGEST:
                    raise InputError(f'{path}: {printable(name)} has {shape} numbers; too many')
            content = loadmat(path, simplify_cells=True, verify_compressed_data_integrity=True)
        self._arrays: dict[str, NDArray[Any]] = {}
        self._collect('', {k: v for k, v in content.items() if not k.startswith('__')}, 0)
        shapes = {name: array.shape for name, array in self._arrays.items()}
        self._columns = arrays.table_columns(str(path), shapes)

    def _collect(self, prefix: str, content: dict[str, Any], depth: int) -> None:
        for key, value in content.items():
            if isinstance(value, dict) and depth < _DEEPEST:
                self._collect(f'{prefix}{key}.', value, depth + 1)
            elif isinstance(value, np.ndarray) and value.dtype.kind in 'fiubU':
                self._arrays[f'{prefix}{key}'] = value

    def columns(self) -> Sequence[LogColumn]:
        """Return all columns."""
        return self._columns

    def read(self, addresses: Sequence[str], progress: Progress) -> Iterator[LogBlock]:
        """Yield rows."""
        yield from arrays.blocks(self._columns, addresses, self._arrays, self.size, progress)
