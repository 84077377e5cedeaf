"""The part of a recording in which a model fails most."""

from collections.abc import Sequence

import numpy as np
from wattwalk_core.arrays import Floats

_SPAN = 12.0  # s shown of a recording
_RATE = 50.0  # Hz


def worst_stretch(residual: Floats, gap_free: Sequence[slice] = ()) -> slice:
    """The part of at most 12 s in which the squared residual is largest.

    gap_free: stretches of rows [N], of which the part lies in one; none: all rows are one.
    """
    best, most = slice(0, 0), -1.0
    for within in gap_free or [slice(0, len(residual))]:
        square = np.square(np.nan_to_num(residual[within]))
        length = min(len(square), round(_SPAN * _RATE))
        summed = np.concatenate([[0.0], np.cumsum(square)])
        spans = summed[length:] - summed[: len(summed) - length]
        start = int(np.argmax(spans))
        if spans[start] > most:
            first = within.start + start
            best, most = slice(first, first + length), float(spans[start])
    return best
