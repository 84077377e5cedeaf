"""Model Confidence Set: those of several models that may be the best."""

from collections.abc import Sequence

import numpy as np
from arch.bootstrap import MCS
from numpy.typing import NDArray

Floats = NDArray[np.float64]

SIZE = 0.1
_REPETITIONS = 500
"""Draws of the bootstrap: a probability of 0.1 is then known to ± sqrt(0.1·0.9/500) = 0.013."""
_BLOCK = 5
"""Blocks drawn together; on the blind subset 2 to 10 decide alike, and 1 names one wrong."""
_ALIKE = 1e-3
"""Mean difference of log errors below which two models are one; between equals the test fails."""


def confidence_set(losses: Sequence[Floats], *, size: float = SIZE, seed: int = 0) -> list[int]:
    """
    Indices of the models that hold the best one with probability 1 − size.

    losses: for each model its loss on each block [B]. Range statistic, stationary bootstrap with
    blocks of 5 (Hansen, Lunde and Nason 2011). Models whose losses differ nowhere stand or fall
    together.
    """
    table = np.stack(losses, axis=1)
    representatives: list[int] = []
    stands_for: list[int] = []
    for column in range(table.shape[1]):
        same = [
            r
            for r in representatives
            if float(np.abs(table[:, column] - table[:, r]).mean()) < _ALIKE
        ]
        stands_for.append(same[0] if same else column)
        if not same:
            representatives.append(column)
    if len(representatives) == 1:
        return list(range(table.shape[1]))
    block = min(_BLOCK, max(1, len(table) // 4))
    test = MCS(
        table[:, representatives],
        size=size,
        reps=_REPETITIONS,
        block_size=block,
        method='R',
        bootstrap='stationary',
        seed=seed,
    )
    test.compute()
    kept = {representatives[int(str(index))] for index in test.included}
    return [column for column in range(table.shape[1]) if stands_for[column] in kept]
