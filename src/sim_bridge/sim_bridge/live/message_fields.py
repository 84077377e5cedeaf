"""Fields of messages by the letters of their names."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray


def assign(target: object, names: str, values: NDArray[np.float64]) -> None:
    """Set the fields `x`, `y`, … of a message to values, one each."""
    set_field: Callable[[object, str, float], None] = setattr
    for name, value in zip(names, values.tolist(), strict=True):
        set_field(target, name, value)
