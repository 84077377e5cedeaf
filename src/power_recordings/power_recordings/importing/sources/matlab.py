"""MAT files: up to version 7.2 with scipy, 7.3 as the HDF5 files that they are."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.errors import InputError, printable

from power_recordings.importing.sources.heads import ArrayLog
from power_recordings.importing.sources.isolated import load_isolated
from power_recordings.importing.sources.source import LogSource, reading

_LARGEST: Final = 1 << 27  # numbers of one variable
_DEEPEST: Final = 8


def open_file(path: Path) -> LogSource:
    """Open a MAT file; InputError for one that is damaged."""
    with path.open('rb') as file:
        head = file.read(128)
    if head[:4] == b'\x89HDF' or b'MATLAB 7.3' in head:
        from power_recordings.importing.sources import check_library  # h5py may be absent
        from power_recordings.importing.sources.hdf5 import Hdf5File

        check_library('hdf5', path)
        return Hdf5File(path)
    return ArrayLog(path, load_isolated('matlab', path, 'MAT file'))


def load(path: Path) -> dict[str, NDArray[Any]]:
    """Return arrays by `variable` or `struct.field`; InputError for a damaged or large file."""
    from scipy.io import loadmat, whosmat  # in a process of its own

    with reading(path, 'MAT file'):
        for name, shape, _ in whosmat(path):
            if min(shape, default=0) < 0 or math.prod(shape) > _LARGEST:
                raise InputError(f'{path}: {printable(name)} has {shape} numbers; too many')
        content = loadmat(path, simplify_cells=True, verify_compressed_data_integrity=True)
    found: dict[str, NDArray[Any]] = {}
    _collect('', {k: v for k, v in content.items() if not k.startswith('__')}, 0, found)
    return found


def _collect(
    prefix: str, content: Mapping[str, Any], depth: int, found: dict[str, NDArray[Any]]
) -> None:
    for key, value in content.items():
        if isinstance(value, dict) and depth < _DEEPEST:
            _collect(f'{prefix}{key}.', value, depth + 1, found)
        elif isinstance(value, np.ndarray) and value.dtype.kind in 'fiubU':
            found[f'{prefix}{key}'] = value
