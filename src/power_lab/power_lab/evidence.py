"""How well a structure predicts what it was not fitted on: blocked cross-validation."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from power_estimator.effect_design import Structure
from power_estimator.effect_fit import Blocks, Fit, Fitter, Normal

Floats = NDArray[np.float64]

FOLDS = 5
PIECE = 10
"""Blocks (of 1 s) that stay together in a fold."""
EMBARGO = 1
"""Blocks left out of the training on either side of what is tested."""
LEAST_MSE = 1e-4
"""W²: errors below this are alike; keeps the logarithm from rewarding luck."""


@dataclass(frozen=True)
class Folds:
    """Which blocks are tested together, and which may be trained on then."""

    test: NDArray[np.int32]  # [B], fold of each block
    training: Floats  # [F, B], 1 where the block may be trained on

    @classmethod
    def of(cls, blocks: Blocks) -> 'Folds':
        """
        Split by recording where there are five or more, else by pieces of 10 s in turn.

        An embargo of 1 s beside each tested piece keeps what is autocorrelated out of training.
        """
        recordings = np.unique(blocks.recording)
        count = len(blocks.starts)
        if len(recordings) >= FOLDS:
            test = np.searchsorted(recordings, blocks.recording) % FOLDS
        else:
            length = int(np.clip(count // (3 * FOLDS), 2, PIECE))
            test = (np.arange(count) // length) % FOLDS
        training = np.ones((FOLDS, count))
        for fold in range(FOLDS):
            tested = test == fold
            near = tested.copy()
            for step in range(1, EMBARGO + 1):
                near[:-step] |= tested[step:]
                near[step:] |= tested[:-step]
            training[fold, near] = 0.0
        return cls(test.astype(np.int32), training)


@dataclass(frozen=True)
class Evidence:
    """Held-out errors of one structure."""

    fit: Fit
    coefficients: Floats  # [F, D, m], of each fold
    mse: Floats  # W² [B, D], NaN where a drive was not measured
    names: tuple[str, ...]  # effects added to the base

    @property
    def loss(self) -> Floats:
        """Summed over drives: log of the mean squared error of each block [B]."""
        return np.nansum(np.log(self.mse + LEAST_MSE), axis=1)

    @property
    def mean_mse(self) -> Floats:
        """W² [D]."""
        return np.nanmean(self.mse, axis=0)

    @property
    def rmse(self) -> Floats:
        """W [D]."""
        return np.sqrt(self.mean_mse)


class Examiner:
    """Cross-validates structures on one set of prepared signals."""

    def __init__(self, fitter: Fitter) -> None:
        self.fitter = fitter
        self.folds = Folds.of(fitter.blocks)

    def examine(self, fit: Fit, names: Sequence[str] = ()) -> Evidence:
        """Held-out errors with the fit's delay and shapes, all coefficients refitted per fold."""
        coefficients = self.fitter.solve(fit.design, fit.normal, fit.weights, self.folds.training)
        return Evidence(fit, coefficients, self.block_mse(fit.normal, coefficients), tuple(names))

    def block_mse(self, normal: Normal, coefficients: Floats) -> Floats:
        """W² [B, D] of each block with its own fold's coefficients [F, D, m]."""
        blocks = self.fitter.blocks
        error = normal.errors(coefficients[self.folds.test]) / blocks.length
        return np.where(blocks.valid, error, np.nan)

    def residual(self, evidence: Evidence) -> Floats:
        """Held-out residual, W [N, D]; NaN outside the blocks."""
        fit, blocks = evidence.fit, self.fitter.blocks
        out = np.full(fit.target.shape, np.nan)
        for fold in range(FOLDS):
            rows = blocks.rows[self.folds.test == fold].ravel()
            model = np.einsum('ndm,dm->nd', fit.design.columns[rows], evidence.coefficients[fold])
            out[rows] = fit.target[rows] - model
        return np.where(self.fitter.prepared.measured, out, np.nan)


def base_structure(structure: Structure) -> tuple[str, ...]:
    """Names of the effects of a structure that are physics."""
    return tuple(a.name for a in structure.actives if a.effect.kind == 'physics')
