"""Readers of logs, one file a format; `open_source` finds the right one."""

import stat
from importlib.util import find_spec
from pathlib import Path
from pkgutil import resolve_name
from typing import Final

from wattwalk_core.errors import InputError
from wattwalk_core.files import reason

from power_recordings.importing.sources.source import LogSource

_BAG: Final = 'bag:BagFile'
_READERS: Final = {
    'delimited:DelimitedFile': ('.csv', '.tsv', '.txt', '.dat', '.log', '.asc', '.prn', '.lvm'),
    'spreadsheet:Spreadsheet': ('.xlsx', '.xlsm'),
    'columnar:ColumnarFile': ('.parquet', '.pq', '.feather', '.arrow'),
    'matlab:open_file': ('.mat',),
    'hdf5:Hdf5File': ('.h5', '.hdf5', '.hdf'),
    'json_lists:open_file': ('.json', '.jsonl', '.ndjson'),
    'hebi:open_file': ('.hebilog',),
    _BAG: ('.bag', '.mcap', '.db3'),
}
"""Endings by the module of this package and what of it opens them."""
_NEEDS: Final = {
    'delimited': ('pyarrow', 'pyarrow'),
    'spreadsheet': ('openpyxl', 'openpyxl'),
    'columnar': ('pyarrow', 'pyarrow'),
    'hdf5': ('h5py', 'h5py'),
    'hebi': ('hebi', '--no-deps hebi-py==2.16.1'),
}
"""Module that a reader needs beyond the required ones, and its name for pip."""


def open_source(path: Path, messages: Path | None = None) -> LogSource:
    """Open a log by the ending of its name; a folder is a rosbag2 bag.

    messages: a folder of .msg files for types that a bag does not define itself. Raises
    InputError for a file that is absent, of an unknown kind, or damaged.
    """
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError) as error:
        raise InputError(f'cannot read {path}: {reason(error)}') from None
    if stat.S_ISDIR(mode):
        return _open(_BAG, path, messages)
    if not stat.S_ISREG(mode):
        raise InputError(f'{path}: not a regular file')
    if not path.stat().st_size:
        raise InputError(f'{path} is empty')
    for reader, endings in _READERS.items():
        if path.suffix.lower() in endings:
            return _open(reader, path, messages)
    known = ' '.join(ending for endings in _READERS.values() for ending in endings)
    raise InputError(f'{path}: unknown kind of file; known are {known} and bag folders')


def _open(reader: str, path: Path, messages: Path | None) -> LogSource:
    check_library(reader.partition(':')[0], path)
    opened = resolve_name(f'{__name__}.{reader}')
    return opened(path, messages) if reader == _BAG else opened(path)  # type: ignore[no-any-return]


def check_library(reader: str, path: Path) -> None:
    """Raise InputError, with the command to install it, if a reader's library is missing."""
    module, package = _NEEDS.get(reader, ('numpy', ''))
    if find_spec(module) is None:
        raise InputError(f'{path}: reading it needs {module}: pip install {package}')
