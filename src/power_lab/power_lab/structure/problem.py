"""Remainder of a drive's power under a base model, for shapes to be fitted beside it."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from power_estimator.effects.fit.blocks import Blocks
from power_estimator.effects.fit.bounded_lsq import bounded_solve
from power_estimator.effects.fit.design_builder import Linearisation
from power_estimator.effects.fit.fitter import Fitter
from power_estimator.effects.fit.folds import Folds
from power_estimator.effects.signals.reducer import REDUCED_RATE
from power_estimator.judge.evidence import Evidence
from wattwalk_core.arrays import Floats


@dataclass(frozen=True)
class Moments:
    """Normal equations of columns and power, by fold.

    The last of the training ones is of everything.
    """

    gram: Floats  # [F + 1, m, m], of the training
    moment: Floats  # [F + 1, m]
    test_gram: Floats  # [F, m, m]
    test_moment: Floats  # [F, m]
    test_square: Floats  # W² [F], sum
    rows: int

    def error(self, coefficients: Floats) -> Floats:
        """Sum of squared held-out errors, W² [..., F], of coefficients [..., F, m]."""
        product = (self.test_gram @ coefficients[..., None])[..., 0]
        linear = (coefficients * (product - 2.0 * self.test_moment)).sum(axis=-1)
        return np.asarray(np.maximum(self.test_square + linear, 0.0))


@dataclass(frozen=True)
class DriveProblem:
    """One drive: the base model's columns and the power that they are fitted to."""

    drive: int
    columns: Floats  # [N, m]
    target: Floats  # W [N]
    lower: Floats  # [m]
    upper: Floats  # [m]
    ridge: Floats  # [m]
    blocks: Blocks  # of this drive, D = 1
    folds: Folds
    residual: Floats  # W [N], held out, NaN where it does not count

    @cached_property
    def scatter(self) -> tuple[Floats, NDArray[np.bool_]]:
        """Columns by block [B, L, m] and the rows that count [B, L]."""
        rows, mask = self.blocks.rows, self.blocks.mask[..., 0]
        return self.columns[rows] * mask[..., None], mask

    @cached_property
    def _alone(self) -> tuple[Moments, Floats]:
        """Moments and coefficients [F + 1, m] of the base model alone."""
        moments = self.moments(None)
        return moments, self.solve(moments, np.zeros((0, 0)))

    @cached_property
    def base_error(self) -> float:
        """Held-out error of the base model, W² by row."""
        moments, solved = self._alone
        return float(moments.error(solved[:-1]).sum() / moments.rows)

    @cached_property
    def free(self) -> NDArray[np.bool_]:
        """Mark the base's columns [m] whose coefficients stand at no bound."""
        return ~self.held(self._alone[1][-1])

    def held(self, coefficients: Floats) -> NDArray[np.bool_]:
        """Mark the base's coefficients [m] that stand at a bound."""
        reach = 1e-7 * (1.0 + np.abs(coefficients))
        low, high = self.lower + reach, self.upper - reach
        return np.asarray((coefficients <= low) | (coefficients >= high))

    def block_moments(self, extra: Floats | None) -> tuple[Floats, Floats, Floats]:
        """Gram [B, m, m], moment [B, m], square [B] of the base columns and extra [N, K]."""
        own, mask = self.scatter
        rows = self.blocks.rows
        if extra is not None:
            own = np.concatenate([own, extra[rows] * mask[..., None]], axis=2)
        target = np.where(mask, np.nan_to_num(self.target[rows]), 0.0)
        turned = own.transpose(0, 2, 1)
        return turned @ own, (turned @ target[..., None])[..., 0], np.square(target).sum(axis=1)

    def moments(self, extra: Floats | None) -> Moments:
        """Moments by fold of the base columns and extra [N, K]."""
        gram, moment, square = self.block_moments(extra)
        train = np.concatenate([self.folds.training, np.ones((1, len(gram)))])
        test = (self.folds.test == np.arange(self.folds.count)[:, None]).astype(np.float64)
        return Moments(
            gram=np.tensordot(train, gram, axes=1),
            moment=train @ moment,
            test_gram=np.tensordot(test, gram, axes=1),
            test_moment=test @ moment,
            test_square=test @ square,
            rows=int(self.blocks.mask.sum()),
        )

    def solve(self, moments: Moments, penalty: Floats) -> Floats:
        """Coefficients [F + 1, m + K] with a penalty [K, K] on what stands beside the base."""
        gram, m = moments.gram.copy(), len(self.ridge)
        gram[:, m:, m:] += penalty
        free = np.full(gram.shape[1] - m, np.inf)
        return bounded_solve(
            gram,
            moments.moment,
            np.concatenate([self.lower, -free]),
            np.concatenate([self.upper, free]),
            np.concatenate([self.ridge, np.zeros(len(free))]),
        )


def problems(
    fitter: Fitter, evidence: Evidence, folds: Folds, residual: Floats
) -> list[DriveProblem]:
    """One problem for each drive that was measured for long enough, from a base model's fit."""
    fit = evidence.fit
    prior = fit.structure.priors(fitter.scale)
    blocks = fitter.blocks
    out = []
    for drive in range(len(fitter.prepared.names)):
        if int(blocks.valid[:, drive].sum()) < 2 * folds.count:
            continue
        own = replace(
            blocks,
            valid=blocks.valid[:, drive : drive + 1],
            use=blocks.use[..., drive : drive + 1],
        )
        weight = float(fitter.weight[drive]) * REDUCED_RATE
        out.append(
            DriveProblem(
                drive=drive,
                columns=fit.design.columns[:, drive],
                target=fit.target[:, drive],
                lower=fit.design.lower[drive],
                upper=fit.design.upper[drive],
                ridge=weight / np.square(prior[drive]),
                blocks=own,
                folds=folds,
                residual=residual[:, drive],
            )
        )
    return out


def price(point: Linearisation, drive: int) -> Floats:
    """Power that a torque on the motor costs, W/(N·m) [T]."""
    s = point.signals
    return np.asarray(s.motor_velocity[:, drive] + s.torque_cost[:, drive])
