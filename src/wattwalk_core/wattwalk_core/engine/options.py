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
    """Processes of this machine, one to a core if `workers` is None, or address of a scheduler.

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
        """Return the workplace of options that a parser with `add_workplace` has parsed."""
        return cls(options.workers, options.scheduler if 'scheduler' in options else '')

    def processes(self, tasks: int) -> int:
        """Return the number of processes of this machine for so many tasks, at least 1."""
        cores = len(os.sched_getaffinity(0))
        return max(min(cores if self.workers is None else self.workers, tasks), 1)


def add_workplace(parser: argparse.ArgumentParser, tasks: str, *, scheduler: bool = True) -> None:
    """Add `--workers` and, unless scheduler is false, `--scheduler` to a parser.

    tasks: plural noun for the units of work, in the help.
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
