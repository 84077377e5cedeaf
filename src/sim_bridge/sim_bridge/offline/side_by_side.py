"""Recordings made side by side in processes, one of each per core."""

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from typing import TypeVar

from wattwalk_core.errors import InputError

Item = TypeVar('Item')
Result = TypeVar('Result')
MOST_WORKERS = 256


def worker_count(workers: int | None, tasks: int) -> int:
    """Return the processes for so many tasks, a core each if None; InputError for a bad number."""
    if workers is None:
        workers = len(os.sched_getaffinity(0))
    if not 1 <= workers <= MOST_WORKERS:
        raise InputError(f'--workers is {workers}; it must lie in 1..{MOST_WORKERS}')
    return max(min(workers, tasks), 1)


def side_by_side(
    task: Callable[[Item], Result], items: Sequence[Item], workers: int
) -> Iterator[Result]:
    """
    Yield the results of a task for each item, in their order.

    One worker is this process. Several are processes that import the task by its name; what one
    raises is raised here, and the others are ended then.
    """
    if workers == 1:
        yield from map(task, items)
        return
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context('spawn'))
    try:
        yield from pool.map(task, items)
    except BaseException:
        for process in multiprocessing.active_children():
            with suppress(OSError):
                process.terminate()
        pool.shutdown(wait=False, cancel_futures=True)
        raise
    pool.shutdown()
