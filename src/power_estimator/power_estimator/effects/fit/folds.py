"""Blocked cross-validation: the blocks of a recording that are fitted and tested."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.arrays import Floats

from power_estimator.effects.fit.blocks import Blocks
from power_estimator.effects.fit.settings import FitSettings


@dataclass(frozen=True)
class Folds:
    """Folds of a cross-validation: blocks that are tested together, and those to train on then."""

    test: NDArray[np.int32]  # [B], fold of each block
    training: Floats  # [F, B], 1 where the block may be trained on

    @property
    def count(self) -> int:
        """Number of folds F."""
        return len(self.training)

    @classmethod
    def of(
        cls, blocks: Blocks, settings: FitSettings | None = None, *, by_recording: bool = True
    ) -> 'Folds':
        """Split by recording where there are enough, else by pieces of 10 s in turn.

        by_recording: False where each recording has coefficients that no other shows. Blocks
        without a measured drive count in no piece, so that short stretches of measurement far
        apart are in all folds. Operating points are dealt out by chance: they are independent, and
        tables are sorted. An embargo beside each tested piece keeps what is autocorrelated out of
        training.
        """
        settings = settings or FitSettings()
        folds, recordings = settings.folds, np.unique(blocks.recording)
        if by_recording and len(recordings) >= folds:
            test = np.searchsorted(recordings, blocks.recording) % folds
        elif blocks.independent:
            test = np.random.default_rng(0).permutation(len(blocks.starts)) % folds
        else:
            place = np.cumsum(blocks.valid.any(axis=1)) - 1
            length = int(np.clip((place[-1] + 1) // (3 * folds), 2, settings.piece))
            test = (np.maximum(place, 0) // length) % folds
        training = np.ones((folds, len(blocks.starts)))
        for fold in range(folds):
            tested = test == fold
            near = tested.copy()
            for step in range(1, 1 if blocks.independent else settings.embargo + 1):
                near[:-step] |= tested[step:]
                near[step:] |= tested[:-step]
            training[fold, near] = 0.0
        return cls(test.astype(np.int32), training)
