"""Blocked cross-validation: the blocks of a recording that are fitted and tested."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from power_estimator.effects.fit.blocks import Blocks

Floats = NDArray[np.float64]

FOLDS = 5
PIECE = 10
"""Blocks (of 1 s) that stay together in a fold."""
EMBARGO = 1
"""Blocks left out of the training on either side of the tested ones."""
LEAST_MSE = 1e-4
"""W²: errors below this are alike; keeps the logarithm from rewarding luck."""


@dataclass(frozen=True)
class Folds:
    """Blocks that are tested together, and those that may then be trained on."""

    test: NDArray[np.int32]  # [B], fold of each block
    training: Floats  # [F, B], 1 where the block may be trained on

    @classmethod
    def of(
        cls,
        blocks: Blocks,
        *,
        by_recording: bool = True,
        count: int = FOLDS,
        piece: int = PIECE,
        embargo: int = EMBARGO,
    ) -> 'Folds':
        """
        Split by recording where there are five or more, else by pieces of 10 s in turn.

        Not by_recording where each has coefficients of its own, which no other tells.

        Blocks without a measured drive count in no piece, so that short stretches of measurement
        far apart are in all folds.
        An embargo beside each tested piece keeps what is autocorrelated out of training.
        """
        recordings = np.unique(blocks.recording)
        if by_recording and len(recordings) >= count:
            test = np.searchsorted(recordings, blocks.recording) % count
        else:
            place = np.cumsum(blocks.valid.any(axis=1)) - 1
            length = int(np.clip((place[-1] + 1) // (3 * count), 2, piece))
            test = (np.maximum(place, 0) // length) % count
        training = np.ones((count, len(blocks.starts)))
        for fold in range(count):
            tested = test == fold
            near = tested.copy()
            for step in range(1, embargo + 1):
                near[:-step] |= tested[step:]
                near[step:] |= tested[:-step]
            training[fold, near] = 0.0
        return cls(test.astype(np.int32), training)
