"""Smooth shapes over one driver: penalised splines beside the base model."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from power_estimator.effects.fit.blocks import Blocks
from power_estimator.effects.fit.bounded_lsq import bounded_solve
from power_estimator.effects.fit.design_builder import Linearisation
from power_estimator.effects.fit.fitter import Fitter
from power_estimator.effects.fit.folds import Folds
from power_estimator.effects.signals.prepared import Prepared
from power_estimator.effects.signals.reducer import REDUCED_RATE
from power_estimator.judge.evidence import Evidence
from wattwalk_core.arrays import Floats

from power_lab.structure.drivers import Family, driver_values, evaluated


@dataclass(frozen=True)
class Moments:
    """Normal equations of m regressors and the power, for F folds.

    The last of the training ones is of all folds together.
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
    """Regression of one drive: m regressors of the base model, and the power to be explained."""

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
        """Regressors by block [B, L, m], 0 in rows that do not count, and mask of rows [B, L]."""
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
        """Mask of the base's coefficients [m] that stand at no bound."""
        return ~self.held(self._alone[1][-1])

    def held(self, coefficients: Floats) -> NDArray[np.bool_]:
        """Mask of the base's coefficients [m] that stand at a bound."""
        reach = 1e-7 * (1.0 + np.abs(coefficients))
        low, high = self.lower + reach, self.upper - reach
        return np.asarray((coefficients <= low) | (coefficients >= high))

    def moments(self, extra: Floats | None) -> Moments:
        """Normal equations by fold of the base's regressors and further ones, extra [N, K]."""
        own, mask = self.scatter
        rows = self.blocks.rows
        if extra is not None:
            own = np.concatenate([own, extra[rows] * mask[..., None]], axis=2)
        target = np.where(mask, np.nan_to_num(self.target[rows]), 0.0)
        turned = own.transpose(0, 2, 1)
        gram, moment = turned @ own, (turned @ target[..., None])[..., 0]
        square = np.square(target).sum(axis=1)
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
        """Coefficients [F + 1, m + K] by fold and of all; penalty [K, K]: of the further ones."""
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
    """Regressions of the drives that were measured for long enough, from a fit of the base.

    residual: held-out residual of that fit, W [N, D].
    """
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
        ridge = float(fitter.weight[drive]) * REDUCED_RATE / np.square(prior[drive])
        out.append(
            DriveProblem(
                drive=drive,
                columns=fit.design.columns[:, drive],
                target=fit.target[:, drive],
                lower=fit.design.lower[drive],
                upper=fit.design.upper[drive],
                ridge=ridge,
                blocks=own,
                folds=folds,
                residual=residual[:, drive],
            )
        )
    return out


NODES, OF_TURN, OF_POSITION = 33, 97, 49
"""Nodes of a shape: over most drivers, over a turn, over a position."""
_SMOOTHING = tuple(10.0**k for k in range(-5, 3))
_AT_ONCE = 17  # columns
_TAIL = 0.002  # of the samples, beyond the outermost nodes


@dataclass(frozen=True)
class LearnedShape:
    """A shape of one family on one drive, with its held-out gain; the last fold is of all."""

    family: Family
    nodes: Floats  # [K], values of the driver
    share: Floats  # [K], of the samples near each node
    by_fold: Floats  # [F + 1, m + K], coefficients of the base and of the shape at the nodes
    moments: Moments
    gain: float  # W² by row, held out

    @property
    def values(self) -> Floats:
        """The shape at its nodes [K]."""
        return self.by_fold[-1, -len(self.nodes) :]


def places(values: Floats, nodes: Floats) -> Floats:
    """Places of values among evenly spaced nodes, 0 at the first, in node spacings [T]."""
    return np.clip((values - nodes[0]) / (nodes[1] - nodes[0]), 0.0, len(nodes) - 1.000001)


def hats(place: Floats, nodes: NDArray[np.intp]) -> Floats:
    """Triangles [T, n] that are 1 at a node and 0 from the next on; nodes: their numbers [n]."""
    out = place[:, None] - nodes
    np.abs(out, out=out)  # in place, as a long recording has many samples
    np.subtract(1.0, out, out=out)
    return np.maximum(out, 0.0, out=out)


def spread(values: Floats, count: int = NODES) -> Floats | None:
    """Evenly spaced nodes [count] over the values' range; None where they hardly vary."""
    low, high = np.quantile(values, (_TAIL, 1.0 - _TAIL))
    if not np.isfinite(high - low) or high - low < 1e-9 * max(abs(low), abs(high), 1e-6):
        return None
    return np.linspace(low, high, count)


def instant(family: Family, point: Linearisation, drive: int) -> tuple[Floats, Floats]:
    """Driver [T] and the weight of its function, W per unit [T], at each sample of a drive."""
    return driver_values(family.driver, point.signals, drive), weight_of(family, point, drive)


def weight_of(family: Family, point: Linearisation, drive: int) -> Floats:
    """Power for one unit of a family's function, W [T], at each sample of a drive."""
    signals = point.signals
    weight = evaluated(family.factor.code, signals, drive) * np.ones(len(signals.time))
    if family.acts_on == 'torque':  # what a torque on the motor costs, W/(N·m)
        weight = weight * (signals.motor_velocity[:, drive] + signals.torque_cost[:, drive])
    return weight


def bend(count: int) -> Floats:
    """Penalty [count, count] on the curvature of a shape at evenly spaced nodes."""
    curvature = np.diff(np.eye(count), n=2, axis=0)
    return np.asarray(curvature.T @ curvature)


def learn(
    problem: DriveProblem, family: Family, point: Linearisation, prepared: Prepared
) -> LearnedShape | None:
    """Learn the shape with the smoothness of least held-out error; None without variation."""
    z, weight = instant(family, point, problem.drive)
    count = {'angle': OF_TURN, 'position': OF_POSITION}.get(family.driver.name, NODES)
    nodes = spread(z, count)
    if nodes is None:
        return None
    place = places(z, nodes)
    share = np.bincount(place.astype(np.intp), minlength=count) / len(z)
    parts = [  # a few columns at a time, to spare memory
        prepared.reduced(hats(place, own) * weight[:, None])
        for own in np.array_split(np.arange(count), -(-count // _AT_ONCE))
    ]
    moments = problem.moments(np.concatenate(parts, axis=1))
    curved = bend(count)
    unit = float(np.trace(moments.gram[-1][-count:, -count:])) / count
    if unit <= 0.0:
        return None
    solved = [
        problem.solve(moments, smoothing * unit * curved + 1e-6 * unit * np.eye(count))
        for smoothing in _SMOOTHING
    ]
    errors = [float(moments.error(own[:-1]).sum()) for own in solved]
    best = min(range(len(errors)), key=errors.__getitem__)
    gain = problem.base_error - errors[best] / moments.rows
    return LearnedShape(family, nodes, share, solved[best], moments, gain)
