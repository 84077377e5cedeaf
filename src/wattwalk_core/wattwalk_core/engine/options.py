"""Arguments of commands that share their work out: --workers and --scheduler."""

import argparse
import os
import re
from dataclasses import dataclass
from typing import Final, Self

from wattwalk_core.errors import InputError, quoted

MOST_WORKERS: Final = 256
_ADDRESS: Final = re.compile(r'(tcp|tls)://[^/\s]+:[0-9]{1,5}')


@dataclass(frozen=True)
class Workplace:
    """Number of processes on this machine, one to a core if None, or address of a scheduler.

    InputError for a number outside 1..256, for an address that is none, and for both.
    """

    workers: int | None = None
    scheduler: str = ''

    def __post_init__(self) -> None:
        if self.workers is not None and not 1 <= self.workers <= MOST_WORKERS:
            raise InputError(f'--workers is {self.workers}; it must lie in 1..{MOST_WORKERS}')
        if not self.scheduler:
            return
        if not _ADDRESS.fullmatch(self.scheduler):
            raise InputError(
                f'--scheduler {quoted(self.scheduler)}: give tcp://HOST:PORT or tls://HOST:PORT'
            )
        if self.workers is not None:
            raise InputError('--workers counts processes of this machine; --scheduler has its own')

    @classmethod
    def of(cls, options: argparse.Namespace) -> Self:
        """Return the workplace given by `add_workplace`'s arguments."""
        return cls(options.workers, options.scheduler if 'scheduler' in options else '')

    def processes(self, tasks: int) -> int:
        """Return the number of processes of this machine for a number of tasks."""
        cores = len(os.sched_getaffinity(0))
        return max(min(cores if self.workers is None else self.workers, tasks), 1)


def add_workplace(parser: argparse.ArgumentParser, tasks: str, *, scheduler: bool = True) -> None:
    """Add the arguments; tasks: plural noun for the units of work.

    scheduler: offers `--scheduler`, for workers on other machines.
    """
    parser.add_argument(
        '--workers', type=int, metavar='N', help=f'{tasks} at a time, one to a core if absent'
    )
    if not scheduler:
        return
    parser.add_argument(
        '--scheduler',
        default='',
        metavar='tcp://HOST:PORT',
        help='of a Dask cluster that does the work; it runs code, so name only one that you trust',
    )
