"""Bounded least squares of models of effects, with intervals that respect autocorrelation."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from power_estimator.effects import Catalogue
from power_estimator.effects.fit.bounded_lsq import bounded_solve
from power_estimator.effects.fit.design import Active, BasePower, Design, DesignBuilder, Structure
from power_estimator.effects.fit.whole_robot import WholeBuilder
from power_estimator.effects.signals.prepared import Prepared
from power_estimator.effects.signals.reducer import REDUCED_RATE
from power_estimator.effects.signals.scale import DriveScale

Floats = NDArray[np.float64]

BLOCK_SECONDS = (1.0, 0.5, 0.25, 0.1)
_FEWEST_BLOCKS = 15
_LEAST_USED = 0.5  # of the rows of a block must be resolved
_BOOTSTRAPS = 200
_BOOTSTRAP_BLOCK = 5  # blocks drawn together
_TIED = 0.9999  # cosine of two columns that a recording cannot tell apart
_FINE_STEP = 0.00025  # s
_REWEIGHTINGS = 2
_AT_BOUND = 1e-6  # of the larger bound
_NEAR = 3  # delays on either side of a known one


@dataclass(frozen=True)
class Blocks:
    """Blocks of a second of reduced samples, shorter in a short recording, that errors are of."""

    starts: NDArray[np.intp]  # [B] first row of each
    length: int
    recording: NDArray[np.int32]  # [B]
    time: Floats  # s [B], of the first row
    valid: NDArray[np.bool_]  # [B, D] where the power of the drive was measured throughout
    use: NDArray[np.bool_]  # [B, length, D] rows whose signals are resolved

    @classmethod
    def of(cls, prepared: Prepared) -> 'Blocks':
        """Cut prepared signals into blocks that cross no gap."""
        window = prepared.reducer.window
        for seconds in (window,) if window else BLOCK_SECONDS:
            length = round(seconds * REDUCED_RATE)
            starts = [
                start
                for part in prepared.reducer.stretches()
                for start in range(part.start, part.stop - length + 1, length)
            ]
            if len(starts) >= _FEWEST_BLOCKS:
                break
        first = np.array(starts, dtype=np.intp)
        rows = first[:, None] + np.arange(length)
        use = prepared.resolved[rows]
        enough = use.mean(axis=1) >= _LEAST_USED
        return cls(
            starts=first,
            length=length,
            recording=prepared.recording[first],
            time=prepared.time[first],
            valid=prepared.measured[rows].all(axis=1) & enough,
            use=use,
        )

    @property
    def rows(self) -> NDArray[np.intp]:
        """Return row indices [B, length]."""
        return self.starts[:, None] + np.arange(self.length)

    @property
    def counts(self) -> NDArray[np.intp]:
        """Rows that count of each block, 1 or more, [B, D]."""
        return np.maximum(self.use.sum(axis=1), 1)

    @property
    def mask(self) -> NDArray[np.bool_]:
        """Mark the rows that count [B, length, D]."""
        return self.use & self.valid[:, None, :]


@dataclass(frozen=True)
class Normal:
    """Normal equations of each block and drive; zero where the power was not measured."""

    gram: Floats  # [B, D, m, m]
    moment: Floats  # [B, D, m]
    square: Floats  # W² [B, D], sum of squared targets
    valid: NDArray[np.bool_]  # [B, D]
    counts: NDArray[np.intp]  # rows of a block that count [B, D]

    @classmethod
    def of(cls, columns: Floats, target: Floats, blocks: Blocks) -> 'Normal':
        """Make normal equations from columns [N, D, m] and target [N, D]."""
        rows = blocks.rows
        x = columns[rows].transpose(0, 2, 3, 1)  # [B, D, m, L]
        y = np.where(blocks.mask, np.nan_to_num(target[rows]), 0.0).transpose(0, 2, 1)
        x = x * blocks.mask.transpose(0, 2, 1)[:, :, None, :]
        gram, moment = x @ x.transpose(0, 1, 3, 2), (x @ y[..., None])[..., 0]
        return cls(gram, moment, np.square(y).sum(axis=2), blocks.valid, blocks.counts)

    def errors(self, coefficients: Floats) -> Floats:
        """Sum of squared residuals, W² [B, D], at coefficients [D, m] or [B, D, m]."""
        product = (
            np.einsum('bdij,...dj->bdi', self.gram, coefficients)
            if coefficients.ndim == 2
            else np.einsum('bdij,bdj->bdi', self.gram, coefficients)
        )
        linear = (coefficients * (product - 2.0 * self.moment)).sum(axis=2)
        return np.maximum(self.square + linear, 0.0)


@dataclass(frozen=True)
class Fit:
    """A structure fitted to all blocks: coefficients of each drive and the common delay."""

    structure: Structure
    coefficients: Floats  # [D, m]
    delay: float  # s, of the power against the joint signals
    design: Design
    normal: Normal
    target: Floats  # W [N, D], power with the delay taken out, less the design's constant
    mse: Floats  # W² [D]
    weights: Floats  # [B, D], low where nothing fits

    @property
    def error(self) -> float:
        """Summed over drives: mean log of the mean squared error of the blocks."""
        count = np.maximum(self.normal.valid.sum(axis=0), 1)
        error = self.normal.errors(self.coefficients) / self.normal.counts
        return float(((np.log(error + 1e-4) * self.normal.valid).sum(axis=0) / count).sum())

    def at_bound(self, drive: int, column: int) -> Literal['', 'lower', 'upper']:
        """`lower` or `upper` where a coefficient stands at its bound, else ''."""
        value = self.coefficients[drive, column]
        low, high = self.design.lower[drive, column], self.design.upper[drive, column]
        near = _AT_BOUND * max(abs(low), abs(high) if np.isfinite(high) else 0.0)
        return 'lower' if value <= low + near else 'upper' if value >= high - near else ''

    def residual(self) -> Floats:
        """Measured minus model, W [N, D]."""
        return self.target - np.einsum('ndm,dm->nd', self.design.columns, self.coefficients)


class Fitter:
    """Fits structures to one set of prepared signals."""

    def __init__(
        self,
        prepared: Prepared,
        *,
        groups: Sequence[Sequence[int]] | None = None,
        base: BasePower | None = None,
    ) -> None:
        """groups: drives that share coefficients, by index; base: a model underneath."""
        self.prepared = prepared
        self.blocks = Blocks.of(prepared)
        self.builder = (
            WholeBuilder(prepared, base) if prepared.whole else DesignBuilder(prepared, base)
        )
        count = len(prepared.names)
        self.groups = [list(g) for g in groups] if groups else [[d] for d in range(count)]
        noise = np.where(np.isfinite(prepared.noise), prepared.noise, 0.1 * self.scale.power)
        self.weight = np.maximum(noise, 0.02 * self.scale.power) ** 2

    @property
    def scale(self) -> DriveScale:
        """Scale of the meters."""
        return self.prepared.scale

    def leave_out(self, events: NDArray[np.bool_]) -> None:
        """Take blocks of drives [B, D] out of all that follows."""
        self.blocks = replace(self.blocks, valid=self.blocks.valid & ~events)

    def fit(
        self,
        structure: Structure,
        start: 'Fit | None' = None,
        iterations: int = 3,
        delay: float | None = None,
    ) -> Fit:
        """
        Fit all coefficients within their bounds, and the delay unless it is given (s).

        start gives the point to linearise about by the names of its effects.
        """
        coefficients = carried(structure, start, len(self.prepared.names))
        weights = np.ones(self.blocks.valid.shape) if start is None else start.weights
        current: Fit | None = None
        near = None if start is None else start.delay
        for _ in range(max(1, iterations)):
            design = self.builder.build(structure, coefficients)
            chosen = self._best_delay(design, weights, near) if delay is None else delay
            current = self._fit_design(design, weights, chosen)
            near = current.delay
            coefficients, weights = current.coefficients, current.weights
        assert current is not None
        return current

    def _fit_design(self, design: Design, weights: Floats, delay: float) -> Fit:
        target = self.prepared.power_at(delay) - design.constant
        normal = Normal.of(design.columns, target, self.blocks)
        for _ in range(_REWEIGHTINGS):
            coefficients = self.solve(design, normal, weights)
            error = normal.errors(coefficients) / self.blocks.counts
            weights = robust_weights(error, self.blocks.valid)
        mse = (error * self.blocks.valid).sum(axis=0) / np.maximum(self.blocks.valid.sum(0), 1)
        return Fit(design.structure, coefficients, delay, design, normal, target, mse, weights)

    def solve(
        self, design: Design, normal: Normal, weights: Floats, drawn: Floats | None = None
    ) -> Floats:
        """
        Coefficients from the blocks at weights [B, D], [D, m].

        With drawn [F, B], how often each block counts in each of F fits, [F, D, m]. Drives of a
        group share theirs.
        """
        gram = normal.gram * weights[:, :, None, None]
        moment = normal.moment * weights[:, :, None]
        if drawn is None:
            gram, moment = gram.sum(axis=0)[None], moment.sum(axis=0)[None]
        else:
            gram = np.tensordot(drawn, gram, axes=1)
            moment = np.tensordot(drawn, moment, axes=1)
        out = np.zeros(moment.shape)
        prior = design.structure.priors(self.scale)
        for group in self.groups:
            ridge = float(self.weight[group].mean()) * REDUCED_RATE / np.square(prior[group[0]])
            lower, upper = design.lower[group].mean(axis=0), design.upper[group].mean(axis=0)
            out[:, group] = bounded_solve(
                gram[:, group].sum(axis=1), moment[:, group].sum(axis=1), lower, upper, ridge
            )[:, None]
        return out if drawn is not None else out[0]

    def _best_delay(self, design: Design, weights: Floats, near: float | None) -> float:
        """The delay with the least error, sought near a known one first."""
        shifts = self.prepared.shifts
        step = float(shifts[1] - shifts[0])
        low, high = 0, len(shifts)
        if near is not None:
            middle = round((near - float(shifts[0])) / step)
            low = int(np.clip(middle - _NEAR, 0, len(shifts) - 2 * _NEAR - 1))
            high = low + 2 * _NEAR + 1
        gram, moment, square, next_ = self._moments(design, weights, slice(low, high))
        coarse = self._profile(design, gram, moment, square)
        best = int(np.argmin(coarse))
        inner = (best > 0 or low == 0) and (best < len(coarse) - 1 or high == len(shifts))
        if not inner:
            return self._best_delay(design, weights, None)
        best = int(np.clip(best, 1, len(coarse) - 2))
        places = np.linspace(best - 1, best + 1, 2 * round(step / _FINE_STEP) + 1)
        fine_moment, fine_square = between(places, moment, square, next_)
        fine = self._profile(design, gram, fine_moment, fine_square)
        return float(shifts[low] + step * places[int(np.argmin(fine))])

    def _moments(
        self, design: Design, weights: Floats, window: slice
    ) -> tuple[Floats, Floats, Floats, Floats]:
        """
        Weighted normal equations at the delays of a window.

        gram [D, m, m], moment [S, D, m], squared target [S, D] and its product with the target at
        the next delay, which the error between two delays needs.
        """
        prepared, blocks = self.prepared, self.blocks
        m, count = design.columns.shape[2], len(prepared.names)
        shifts = len(prepared.shifts[window])
        gram = np.zeros((count, m, m))
        moment = np.zeros((shifts, count, m))
        square, next_ = np.zeros((shifts, count)), np.zeros((shifts, count))
        for drive in range(count):
            mask = blocks.mask[..., drive]
            used = blocks.rows[mask]
            root = np.sqrt(np.repeat(weights[:, drive], mask.sum(axis=1)))
            x = design.columns[used, drive] * root[:, None]
            y = prepared.power[window, used, drive].astype(np.float64)
            y = (y - design.constant[used, drive]) * root
            gram[drive] = x.T @ x
            moment[:, drive] = y @ x
            square[:, drive] = np.einsum('sn,sn->s', y, y)
            next_[:-1, drive] = np.einsum('sn,sn->s', y[:-1], y[1:])
        return gram, moment, square, next_

    def _profile(self, design: Design, gram: Floats, moment: Floats, square: Floats) -> Floats:
        prior = design.structure.priors(self.scale)
        total = np.zeros(len(moment))
        for group in self.groups:
            ridge = float(self.weight[group].mean()) * REDUCED_RATE / np.square(prior[group[0]])
            lower, upper = design.lower[group].mean(axis=0), design.upper[group].mean(axis=0)
            matrix = gram[group].sum(axis=0)
            right = moment[:, group].sum(axis=1)
            batch = np.broadcast_to(matrix, (len(right), *matrix.shape)).copy()
            x = bounded_solve(batch, right, lower, upper, ridge)
            error = square[:, group].sum(axis=1) - 2 * (x * right).sum(axis=1)
            error = error + np.einsum('si,ij,sj->s', x, matrix, x)
            total += len(group) * np.log(np.maximum(error, 1e-9))
        return total

    def intervals(self, fit: Fit, seed: int = 0, level: float = 0.95) -> Floats:
        """
        Bounds of each coefficient, [D, m, 2], by a moving-block bootstrap of 5 s.

        Blocks drawn together keep what is autocorrelated together; coefficients at a bound get
        an interval that ends there, and coefficients whose columns are the same in this recording
        one that lets either take all. Delay, shapes and the weights of the blocks are held.
        """
        random = np.random.default_rng(seed)
        count = len(self.blocks.starts)
        size = min(_BOOTSTRAP_BLOCK, count)
        draws = -(-count // size)
        drawn = np.zeros((_BOOTSTRAPS, count))
        for row in drawn:
            starts = random.integers(0, count - size + 1, draws)
            np.add.at(row, (starts[:, None] + np.arange(size)).ravel(), 1.0)
        sampled = self.solve(fit.design, fit.normal, fit.weights, drawn)
        tails = [(1 - level) / 2, (1 + level) / 2]
        found: Floats = np.quantile(sampled, tails, axis=0).transpose(1, 2, 0)
        return self._with_ties(fit, found)

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
            if one != other and alike[drive, one, other] > _TIED:
                ratio = scale[drive, other] / scale[drive, one]
                most = out[drive, one, 1] + ratio * bounds[drive, other, 1]
                out[drive, one, 1] = min(most, fit.design.upper[drive, one])
                out[drive, one, 0] = fit.design.lower[drive, one]
        return out


def between(
    places: Floats, moment: Floats, square: Floats, next_: Floats
) -> tuple[Floats, Floats]:
    """
    Moment [S, D, m] and squared target [S, D] at places [P] between S delays.

    The target is interpolated linearly; next_ [S, D] is its product with that at the next delay.
    """
    left = np.minimum(places.astype(int), len(moment) - 2)
    w = (places - left)[:, None]
    moments = (1 - w)[..., None] * moment[left] + w[..., None] * moment[left + 1]
    squares = (1 - w) ** 2 * square[left] + w**2 * square[left + 1] + 2 * w * (1 - w) * next_[left]
    return moments, squares


def robust_weights(error: Floats, valid: NDArray[np.bool_]) -> Floats:
    """
    Weight of each block from its mean squared error [B, D]; 1 for the drive's median block.

    A stumble or a push that no model follows weighs little, as it does in the mean of the log
    error by which models are compared.
    """
    middle = np.nanmedian(np.where(valid, error, np.nan), axis=0)
    middle = np.maximum(np.nan_to_num(middle), 1e-6)
    return np.asarray(2.0 * middle / (middle + error))


def carried(structure: Structure, start: Fit | None, drives: int) -> Floats:
    """Coefficients [D, m] of the structure, taken over by name; zero where start has none."""
    out = np.zeros((drives, len(structure.labels)))
    if start is None:
        return out
    known = {label: i for i, label in enumerate(start.structure.labels)}
    for column, label in enumerate(structure.labels):
        if label in known:
            out[:, column] = start.coefficients[:, known[label]]
    return out


def measurement_terms(catalogue: Catalogue, *, shaft: bool) -> tuple[Active, ...]:
    """Terms that every model is fitted with; the gain only where the shaft's is known."""
    names = [
        *(['power_gain', 'torque_bend'] if shaft else []),
        *('current_offset', 'offset_drift', 'torque_bias', 'velocity_lag'),
    ]
    return tuple(Active.of(catalogue[name]) for name in names)
