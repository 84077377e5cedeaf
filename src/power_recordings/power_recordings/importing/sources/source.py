"""The interface of logs: columns by address, read in blocks."""

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError, printable

Progress = Callable[[int], None]
MOST_COLUMNS = 20_000
_ROOM = 64 << 20  # bytes of numbers in any file, however small
_RATIO = 200  # bytes of numbers to a byte of the file, at most


@dataclass(frozen=True)
class LogColumn:
    """One signal of a log.

    address: as a map's `from` has it. stream: columns of one stream share their times. unit: as
    far as the log says it, else ''. rows: None where only reading tells.
    """

    address: str
    stream: str
    unit: str = ''
    rows: int | None = None


@dataclass(frozen=True)
class LogBlock:
    """Some consecutive rows of one stream.

    values: by address, float64 [N] (NaN for what is no number), or texts [N] where dates are.
    header_ns, log_ns: stamps of a bag's messages [N]; None for tables.
    """

    stream: str
    values: dict[str, NDArray[Any]]
    header_ns: NDArray[np.int64] | None = None
    log_ns: NDArray[np.int64] | None = None
    notes: tuple[str, ...] = field(default=())

    def __len__(self) -> int:
        arrays = [*self.values.values(), self.log_ns]
        return next((len(a) for a in arrays if a is not None), 0)


class LogSource(ABC):
    """A log file. Its constructor raises InputError for a file that it cannot read."""

    is_bag = False

    def __init__(self, path: Path) -> None:
        self.path = path
        self.size = path.stat().st_size  # bytes, for progress

    @abstractmethod
    def columns(self) -> Sequence[LogColumn]:
        """Return all columns."""

    @abstractmethod
    def read(self, addresses: Sequence[str], progress: Progress) -> Iterator[LogBlock]:
        """Yield the rows of columns in blocks; `progress` is called with bytes read so far."""


def first_rows(
    blocks: Iterator[LogBlock], columns: Sequence[LogColumn], enough: int
) -> Iterator[LogBlock]:
    """Yield blocks until each stream of the columns has `enough` rows or the log ends."""
    rows = {column.stream: 0 for column in columns}
    for block in blocks:
        rows[block.stream] = rows.get(block.stream, 0) + len(block)
        yield block
        if min(rows.values()) >= enough:
            return


def first_values(
    source: LogSource, columns: Sequence[LogColumn], enough: int
) -> dict[str, Floats]:
    """Return up to `enough` first rows of numeric columns, [N] by address, in the log's units."""
    parts: dict[str, list[Floats]] = {}
    rows: Counter[str] = Counter()
    blocks = source.read([column.address for column in columns], lambda done: None)
    for block in first_rows(blocks, columns, enough):
        for address, values in block.values.items():
            if values.dtype.kind != 'O' and rows[address] < enough:
                parts.setdefault(address, []).append(values)
                rows[address] += len(values)
    return {address: np.concatenate(arrays)[:enough] for address, arrays in parts.items()}


def rows_at_once(columns: int) -> int:
    """Return the rows of a block of `columns` columns: about 32 MB, within 64 to 65,536."""
    return max(64, min(65_536, 4_000_000 // max(columns, 1)))


@contextmanager
def reading(path: Path, kind: str) -> Iterator[None]:
    """Turn any exception of the block into InputError: PATH: not a readable KIND: reason."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        reason = printable(str(error)) or type(error).__name__
        raise InputError(f'{path}: not a readable {kind}: {reason}') from None


def check_room(path: Path, size: int, claimed: int) -> None:
    """Raise InputError if a file of `size` bytes claims to unpack to far more than it can."""
    if claimed > _ROOM + _RATIO * size:
        raise InputError(
            f'{path}: claims {claimed >> 20} MiB of numbers in a file of {size} bytes; damaged, '
            'or empty inside'
        )


def number(values: Any) -> Floats:
    """Return values as float64 [N]; what is no number becomes NaN."""
    array = np.asarray(values)
    if array.dtype.kind in 'fiub':
        return array.astype(np.float64)
    result = np.full(len(array), np.nan)
    for i, value in enumerate(array.tolist()):
        try:
            result[i] = float(value)
        except (TypeError, ValueError, OverflowError):
            continue
    return result
