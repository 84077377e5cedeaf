"""The part of a recording in which a model fails most."""

import numpy as np
from numpy.typing import NDArray

_SPAN = 12.0  # s shown of a recording
_RATE = 50.0  # Hz


def worst_stretch(residual: NDArray[np.float64]) -> slice:
    """The part of 12 s in which the squared residual is largest."""
    length = min(len(residual), round(_SPAN * _RATE))
    summed = np.concatenate([[0.0], np.cumsum(np.square(np.nan_to_num(residual)))])
    start = int(np.argmax(summed[length:] - summed[:-length])) if len(residual) > length else 0
    return slice(start, start + length)
