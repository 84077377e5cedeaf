"""The same work for each of several drives, on the cores that numpy's products may use."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import TypeVar

from threadpoolctl import ThreadpoolController

Item = TypeVar('Item')
Result = TypeVar('Result')


def for_each(function: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
    """
    Return the function's results in the order of the items.

    As many threads share the work as a matrix product may use, and each product has one of them
    meanwhile: whoever limits those limits these. The results do not depend on the number of
    threads; the function must not change what it shares.
    """
    controller = _controller()
    threads = min(_allowed(controller), len(items))
    if threads < 2:
        return [function(item) for item in items]
    with controller.limit(limits=1, user_api='blas'), ThreadPoolExecutor(threads) as pool:
        return list(pool.map(function, items))


@cache
def _controller() -> ThreadpoolController:
    import scipy.linalg.blas  # noqa: F401  its library counts, too

    return ThreadpoolController()


def _allowed(controller: ThreadpoolController) -> int:
    counts = [int(one['num_threads']) for one in controller.info() if one['user_api'] == 'blas']
    return min(counts, default=1)
