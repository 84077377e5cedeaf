"""Bounded least squares of models of effects, with intervals that respect autocorrelation."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from wattwalk_core.arrays import Bools, Floats

from power_estimator.effects import Catalogue
from power_estimator.effects.fit.blocks import Blocks, Normal, drawn_blocks, modelled
from power_estimator.effects.fit.bounded_lsq import bounded_solve
from power_estimator.effects.fit.by_drive import ByDriveBuilder
from power_estimator.effects.fit.delay_search import DelaySearch, group_limits, summed
from power_estimator.effects.fit.design import Active, BasePower, Design, Prior, Structure
from power_estimator.effects.fit.design_builder import DesignBuilder, Kept
from power_estimator.effects.fit.settings import FitSettings
from power_estimator.effects.fit.whole_robot import WholeBuilder
from power_estimator.effects.signals.prepared import Prepared
from power_estimator.effects.signals.reducer import REDUCED_RATE
from power_estimator.effects.signals.scale import DriveScale


@dataclass(frozen=True)
class Linear:
    """Linear problem that a fit was solved from."""

    design: Design
    target: Floats  # W [N, D], power with the delay taken out, less the design's constant
    normal: Normal

    @property
    def size(self) -> int:
        """Memory that it needs, bytes."""
        return self.design.columns.nbytes + self.normal.gram.nbytes + 2 * self.target.nbytes


@dataclass(frozen=True, eq=False)
class Fit:
    """Structure fitted to all blocks: coefficients of each drive and the common delay.

    Design, target and normal equations are large: a fitter keeps those used last, and makes others
    anew when they are used.
    """

    structure: Structure
    coefficients: Floats  # [D, m]
    delay: float  # s, of the power against the joint signals
    point: Floats  # [D, m], coefficients that the design is linearised about
    lower: Floats  # [D, m]
    upper: Floats  # [D, m]
    mse: Floats  # W² [D]
    weights: Floats  # [B, D], low where nothing fits
    error: float  # summed over drives: mean log of the mean squared error of the blocks
    blocks: Blocks
    fitter: 'Fitter' = field(repr=False)
    # A fitter keeps by this, not by the fit: both would only go with the garbage collector.
    key: object = field(init=False, repr=False, default_factory=object)

    @property
    def design(self) -> Design:
        """Structure as linearised about `point`."""
        return self.fitter.linear(self).design

    @property
    def normal(self) -> Normal:
        """Normal equations of the blocks."""
        return self.fitter.linear(self).normal

    @property
    def target(self) -> Floats:
        """Power with the delay taken out, less the constant of the design, W [N, D]."""
        return self.fitter.linear(self).target

    def at_bound(self, drive: int, column: int) -> Literal['', 'lower', 'upper']:
        """Return `lower` or `upper` where a coefficient stands at its bound, else ''."""
        value = self.coefficients[drive, column]
        low, high = self.lower[drive, column], self.upper[drive, column]
        near = self.fitter.settings.at_bound * max(
            abs(low), abs(high) if np.isfinite(high) else 0.0
        )
        return 'lower' if value <= low + near else 'upper' if value >= high - near else ''

    def residual(self) -> Floats:
        """Return measured − modelled power, W [N, D]."""
        linear = self.fitter.linear(self)
        return linear.target - modelled(linear.design.columns, self.coefficients)


class Fitter:
    """Fits structures to one set of prepared signals by bounded least squares."""

    def __init__(
        self,
        prepared: Prepared,
        *,
        groups: Sequence[Sequence[int]] | None = None,
        base: BasePower | None = None,
        settings: FitSettings | None = None,
        prior: Prior | None = None,
    ) -> None:
        """groups: drives that share coefficients, by index; by default none do.

        base: power of a base model; prior: expected coefficients, which count like a second of
        measurement.
        """
        self.prior = prior or {}
        self.prepared = prepared
        self.settings = settings = settings or FitSettings()
        self.blocks = Blocks.of(prepared, settings)
        count = len(prepared.names)
        several = ByDriveBuilder if count > 1 else DesignBuilder
        self.builder = (WholeBuilder if prepared.whole else several)(prepared, base, settings.kept)
        self.groups = [list(g) for g in groups] if groups else [[d] for d in range(count)]
        noise = np.where(np.isfinite(prepared.noise), prepared.noise, 0.1 * self.scale.power)
        self.weight = np.maximum(noise, settings.least_noise * self.scale.power) ** 2
        self.delays = DelaySearch(prepared, self.groups, self.weight, settings)
        self._kept: Kept[Linear] = Kept(settings.kept)

    @property
    def scale(self) -> DriveScale:
        """Scale of the metered drives, or of the robot."""
        return self.prepared.scale

    def fit(
        self,
        structure: Structure,
        start: 'Fit | None' = None,
        iterations: int = 3,
        delay: float | None = None,
    ) -> Fit:
        """Fit all coefficients within their bounds, and the delay (s) unless it is given.

        start: a fit whose coefficients, by effect, are the first point to linearise about.
        iterations: linearisations at most; fewer where a step no longer moves what these depend
        on.
        """
        settings = self.settings
        point = carried(structure, start, len(self.prepared.names))
        weights = np.ones(self.blocks.valid.shape) if start is None else start.weights
        near = None if start is None else start.delay
        current: Fit | None = None
        for left in reversed(range(max(1, iterations))):
            design = self.builder.build(structure, point, keep=current is None)
            normal, chosen = self.delays.found(design, self.blocks, weights, near, delay)
            current = self._solved(design, normal, point, weights, chosen, settings.reweightings)
            still = near is not None and abs(chosen - near) <= settings.fine_delay
            if left and still and self._settled(current, design, normal):
                more = settings.reweightings * min(left, 3)
                current = self._solved(design, normal, point, current.weights, chosen, more)
                break
            near, point, weights = current.delay, current.coefficients, current.weights
        assert current is not None
        target = self.prepared.power_at(current.delay) - design.constant
        linear = Linear(design, target, normal)
        self._kept.put(current.key, linear, linear.size)
        return current

    def linear(self, fit: Fit) -> Linear:
        """Return the linear problem of a fit, made anew where it is no longer kept."""

        def make() -> Linear:
            design = self.builder.build(fit.structure, fit.point)
            target = self.prepared.power_at(fit.delay) - design.constant
            return Linear(design, target, Normal.of(design.columns, target, fit.blocks))

        return self._kept.get(fit.key, make, lambda linear: linear.size)

    def _solved(
        self,
        design: Design,
        normal: Normal,
        point: Floats,
        weights: Floats,
        delay: float,
        reweightings: int,
    ) -> Fit:
        near = point
        for _ in range(reweightings):
            near = coefficients = self.solve(design, normal, weights, near=near)
            error = normal.errors(coefficients) / self.blocks.counts
            weights = robust_weights(error, self.blocks.valid)
        count = np.maximum(self.blocks.valid.sum(axis=0), 1)
        logs = np.log(error + 1e-4) * self.blocks.valid
        return Fit(
            structure=design.structure,
            coefficients=coefficients,
            delay=delay,
            point=point,
            lower=design.lower,
            upper=design.upper,
            mse=(error * self.blocks.valid).sum(axis=0) / count,
            weights=weights,
            error=float((logs.sum(axis=0) / count).sum()),
            blocks=self.blocks,
            fitter=self,
        )

    def _settled(self, fit: Fit, design: Design, normal: Normal) -> bool:
        """Return whether the design would be the same at the fit's coefficients.

        It moves with the coefficients of what the motor's torque and speed consist of, and
        discrepancies are bounded by those of their effects.
        """
        _, upper = fit.structure.bounds(fit.coefficients, self.scale)
        same = np.isclose(upper, fit.upper, rtol=self.settings.settled_bound, atol=0.0)
        if not same.all():
            return False
        step = (fit.coefficients - fit.point) * fit.structure.coupled(fit.coefficients)
        gram = normal.gram.sum(axis=0)
        count = np.maximum((self.blocks.counts * self.blocks.valid).sum(axis=0), 1)
        moved = np.einsum('di,dij,dj->d', step, gram, step) / count
        return bool((moved <= np.square(self.settings.settled) * fit.mse).all())

    def solve(
        self,
        design: Design,
        normal: Normal,
        weights: Floats,
        drawn: Floats | None = None,
        near: Floats | None = None,
    ) -> Floats:
        """Return coefficients [D, m] from the blocks with weights [B, D].

        With drawn [F, B], how often each block counts in each of F fits, they are [F, D, m].
        Drives of a group share theirs. near [D, m]: coefficients of a similar fit, to begin at.
        """
        count, drives, m = normal.moment.shape
        gram = np.empty((1 if drawn is None else len(drawn), drives, m, m))
        moment = np.empty(gram.shape[:3])
        for drive in range(drives):
            own = weights[:, drive] * (np.ones((1, count)) if drawn is None else drawn)
            gram[:, drive] = (own @ normal.gram[:, drive].reshape(count, -1)).reshape(-1, m, m)
            moment[:, drive] = own @ normal.moment[:, drive]
        prior = design.structure.priors(self.scale)
        limits = group_limits(design, prior, self.weight, self.groups)
        matrix, right = (summed(each, self.groups, 1) for each in (gram, moment))
        expected, spread = design.structure.expected(self.prior)
        weight = np.stack([self.weight[group].mean() for group in self.groups])
        trust = weight[:, None] * REDUCED_RATE / np.square(spread)
        right = right + trust * expected
        limits = (*limits[:2], limits[2] + trust)
        begin = None if near is None else near[[group[0] for group in self.groups]]
        lower, upper, ridge = (np.tile(values, (len(right), 1)) for values in limits)
        start = None if begin is None else np.tile(begin, (len(right), 1))
        x = bounded_solve(
            matrix.reshape(-1, m, m), right.reshape(-1, m), lower, upper, ridge, start
        )
        out = np.zeros(moment.shape)
        for index, group in enumerate(self.groups):
            out[:, group] = x.reshape(right.shape)[:, index, None]
        return out if drawn is not None else out[0]

    def intervals(self, fit: Fit, seed: int = 0, level: float = 0.95) -> Floats:
        """Return bounds of each coefficient, [D, m, 2], by a moving-block bootstrap of 5 s.

        level: share of the draws between them. A coefficient at a bound gets an interval that ends
        there. Where the recording only shows the sum of two, each interval lets either take all.
        Delay, shapes and weights of the blocks are held.
        """
        linear = self.linear(fit)
        drawn = self.drawn(self.settings.bootstraps, seed)
        sampled = self.solve(linear.design, linear.normal, fit.weights, drawn, fit.coefficients)
        tails = [(1 - level) / 2, (1 + level) / 2]
        found: Floats = np.quantile(sampled, tails, axis=0).transpose(1, 2, 0)
        return self._with_ties(fit, found)

    def delay_draws(self, fit: Fit, repetitions: int, seed: int = 0) -> Floats:
        """Return the delays of the power, s [R], of R = `repetitions` bootstraps of the blocks."""
        drawn = self.drawn(repetitions, seed)
        return self.delays.drawn(fit.design, self.blocks, fit.weights, fit.delay, drawn)

    def drawn(self, repetitions: int, seed: int) -> Floats:
        """Return how often each block is drawn in R moving-block bootstraps, [R, B]."""
        together = 1 if self.blocks.independent else self.settings.drawn_together
        return drawn_blocks(len(self.blocks.starts), repetitions, together, seed)

    def _with_ties(self, fit: Fit, bounds: Floats) -> Floats:
        """Widen the bounds [D, m, 2] of coefficients that only their sum is known of."""
        gram = np.einsum('bdij,bd->dij', fit.normal.gram, fit.weights)
        scale = np.sqrt(np.maximum(np.einsum('dii->di', gram), 1e-300))
        alike = gram / (scale[:, :, None] * scale[:, None, :])
        physics = [
            column
            for active in fit.structure.free
            if active.effect.kind == 'physics'
            for column in fit.structure.columns_of(active.name)
        ]
        out = bounds.copy()
        for drive, one, other in itertools.product(range(len(gram)), physics, physics):
            if one != other and alike[drive, one, other] > self.settings.tied:
                ratio = scale[drive, other] / scale[drive, one]
                most = out[drive, one, 1] + ratio * bounds[drive, other, 1]
                out[drive, one, 1] = min(most, fit.upper[drive, one])
                out[drive, one, 0] = fit.lower[drive, one]
        return out


def robust_weights(error: Floats, valid: Bools) -> Floats:
    """Return the weight of each block by its mean squared error [B, D]; 1 for the median block.

    A stumble or a push that no model follows weighs little, as it does in the mean of the log
    error by which models are compared.
    """
    middle = np.nanmedian(np.where(valid, error, np.nan), axis=0)
    middle = np.maximum(np.nan_to_num(middle), 1e-6)
    return np.asarray(2.0 * middle / (middle + error))


def carried(structure: Structure, start: Fit | None, drives: int) -> Floats:
    """Return start's coefficients for the columns of a structure [D, m]; zero for new ones."""
    out = np.zeros((drives, len(structure.labels)))
    if start is None:
        return out
    known = {label: i for i, label in enumerate(start.structure.labels)}
    for column, label in enumerate(structure.labels):
        if label in known:
            out[:, column] = start.coefficients[:, known[label]]
    return out


def measurement_terms(
    catalogue: Catalogue, *, shaft: bool, steady: bool = False
) -> tuple[Active, ...]:
    """Return the errors of measurement that every model is fitted with, as active effects.

    The gain only with shaft, whose coefficient is known; what needs time not for steady points.
    """
    names = [
        *(['power_gain', 'torque_bend'] if shaft else []),
        *('current_offset', 'offset_drift', 'torque_bias', 'velocity_lag'),
    ]
    terms = (catalogue[name] for name in names)
    return tuple(Active.of(term) for term in terms if not (steady and term.needs_time))
