"""Functions over arrays, compiled to machine code by numba."""

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit

Function = TypeVar('Function', bound=Callable[..., object])


def compiled(signature: str) -> Callable[[Function], Function]:
    """Return a decorator that compiles a function when its module is imported.

    signature: of numba, such as `void(f8[:, ::1], i8)`. Other types of arguments raise TypeError.
    The code is kept on disk for the next process, beside the module or in numba's cache folder.
    Arithmetic is IEEE without reordering, so a result differs from numpy's by the rounding of
    sums, powers and transcendental functions alone, and is the same in every process.
    """

    def decorate(function: Function) -> Function:
        try:
            built: Any = njit(signature, cache=True, error_model='numpy')(function)
        except RuntimeError:  # no folder to keep the code in
            built = njit(signature, error_model='numpy')(function)
        return cast(Function, built)

    return decorate
