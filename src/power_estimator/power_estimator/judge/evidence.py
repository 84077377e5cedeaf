"""Blocked cross-validation: errors of a structure on data that it was not fitted to."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from wattwalk_core.arrays import Floats

from power_estimator.effects.fit.blocks import modelled
from power_estimator.effects.fit.design import Active
from power_estimator.effects.fit.fitter import Fit, Fitter
from power_estimator.effects.fit.folds import Folds


@dataclass(frozen=True)
class Evidence:
    """Held-out errors of one structure."""

    fit: Fit
    coefficients: Floats  # [F, D, m], of each fold
    mse: Floats  # W² [B, D], NaN where a drive was not measured
    names: tuple[str, ...]  # effects added to the base

    @property
    def actives(self) -> tuple[Active, ...]:
        """Added effects in their shapes."""
        return tuple(a for a in self.fit.structure.actives if a.name in self.names)

    @property
    def mean_mse(self) -> Floats:
        """Held-out mean squared error of each drive, W² [D]."""
        return np.nanmean(self.mse, axis=0)

    @property
    def rmse(self) -> Floats:
        """Held-out RMS error of each drive, W [D]."""
        return np.sqrt(self.mean_mse)


class Examiner:
    """Cross-validates structures on one set of prepared signals."""

    def __init__(
        self, fitter: Fitter, *, by_recording: bool = True, folds: Folds | None = None
    ) -> None:
        """by_recording: as in `Folds.of`; folds: to be used in place of those."""
        self.fitter = fitter
        self.folds = folds or Folds.of(fitter.blocks, fitter.settings, by_recording=by_recording)

    def examine(self, fit: Fit, names: Sequence[str] = ()) -> Evidence:
        """Return held-out errors of a fit: coefficients are refitted per fold, the rest is kept.

        names: effects of the structure that were added to a base, for the evidence.
        """
        linear = self.fitter.linear(fit)
        coefficients = self.fitter.solve(
            linear.design, linear.normal, fit.weights, self.folds.training, fit.coefficients
        )
        blocks = self.fitter.blocks
        mse = linear.normal.errors(coefficients[self.folds.test]) / blocks.counts
        mse = np.where(blocks.valid, mse, np.nan)
        return Evidence(fit, coefficients, mse, tuple(names))

    def residual(self, evidence: Evidence, *, all_rows: bool = False) -> Floats:
        """Return the held-out residual, measured − model, W [N, D]; NaN outside the blocks.

        NaN as well where signals are unresolved, unless all_rows.
        """
        fit, blocks = evidence.fit, self.fitter.blocks
        linear = self.fitter.linear(fit)
        out = np.full(linear.target.shape, np.nan)
        for fold in range(self.folds.count):
            rows = blocks.rows[self.folds.test == fold].ravel()
            model = modelled(linear.design.columns[rows], evidence.coefficients[fold])
            out[rows] = linear.target[rows] - model
        prepared = self.fitter.prepared
        counts = prepared.measured & (all_rows | prepared.resolved)
        return np.where(counts, out, np.nan)
