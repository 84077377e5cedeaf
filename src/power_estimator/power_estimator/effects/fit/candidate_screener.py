"""All candidate effects in all their shapes, linearised about one fit: any subset at no cost."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from power_estimator.effects.fit.bounded_lsq import bounded_solve
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.effects.fit.fitter import Fit, Fitter, between
from power_estimator.effects.fit.folds import FOLDS, LEAST_MSE, Folds
from power_estimator.effects.signals.reducer import REDUCED_RATE

Floats = NDArray[np.float64]
_FINE = 8  # delays tried between two neighbours


@dataclass(frozen=True)
class Screened:
    """Held-out errors of a subset of the candidates on top of the base."""

    actives: tuple[Active, ...]
    mse: Floats  # W² [B, D], NaN where not measured
    training_error: float  # summed log of the error of the fit to everything
    delay: float  # s

    @property
    def loss(self) -> float:
        """Mean over blocks of the summed log error."""
        return float(np.nansum(np.log(self.mse + LEAST_MSE), axis=1).mean())

    @property
    def mean_mse(self) -> Floats:
        """Mean squared error, W² [D]."""
        return np.nanmean(self.mse, axis=0)


class CandidateScreener:
    """Screens subsets of candidates by their normal equations alone."""

    def __init__(
        self, fitter: Fitter, folds: Folds, base: Fit, candidates: Sequence[Active]
    ) -> None:
        self.fitter, self.folds, self.base = fitter, folds, base
        self.candidates = tuple(candidates)
        builder = fitter.builder
        point = builder.point(base.structure, base.coefficients)
        parts = [builder.columns(active, point) for active in base.structure.free]
        parts += [builder.columns(active, point) for active in self.candidates]
        self._columns = np.concatenate(parts, axis=2)
        own = self._columns[..., : base.design.columns.shape[2]]
        self._constant = builder.constant(point, own)
        scale = fitter.scale
        lower, upper = base.structure.bounds(base.coefficients, scale)
        for active in self.candidates:
            none = np.zeros((len(lower), len(active.effect.terms)))
            ends = Structure((active,)).bounds(none, scale)
            lower = np.concatenate([lower, ends[0]], axis=1)
            upper = np.concatenate([upper, ends[1]], axis=1)
        self._lower, self._upper = lower, upper
        priors = [base.structure.priors(scale)]
        priors += [Structure((active,)).priors(scale) for active in self.candidates]
        self._prior = np.concatenate(priors, axis=1)
        self._own = base.design.columns.shape[2]
        ends = self._own + np.cumsum([len(a.effect.terms) for a in self.candidates])
        self._place = {
            (active.name, active.shape): list(range(int(end) - len(active.effect.terms), int(end)))
            for active, end in zip(self.candidates, ends, strict=True)
        }

    def screen(self, actives: Sequence[Active] = ()) -> Screened:
        """Held-out errors with these candidates added, at their own best delay."""
        columns = list(range(self._own))
        for active in actives:
            columns += self._place[active.name, active.shape]
        pick = np.array(columns)
        gram = self._gram[:, :, pick[:, None], pick]
        total = np.einsum('bdij,bd->dij', gram, self.base.weights)
        moment = self._moment[..., pick]
        weighted = np.einsum('sbdi,bd->sdi', moment, self.base.weights)
        place, error = self._best_delay(total, weighted, pick, self.base.weights)
        left = min(int(place), moment.shape[0] - 2)
        w = place - left
        own = (1 - w) * moment[left] + w * moment[left + 1]
        square = (
            (1 - w) ** 2 * self._square[left]
            + w**2 * self._square[left + 1]
            + 2 * w * (1 - w) * self._next[left]
        )
        mse = self._held_out(gram, own, square, pick)
        shifts = self.fitter.prepared.shifts
        delay = float(shifts[0] + place * (shifts[1] - shifts[0]))
        return Screened(tuple(actives), mse, error, delay)

    def delay(self, drawn: Floats) -> float:
        """Best delay (s) of the base alone with the blocks counted drawn [B] times."""
        pick = np.arange(self._own)
        weights = self.base.weights * drawn[:, None]
        gram = np.einsum('bdij,bd->dij', self._gram[:, :, pick[:, None], pick], weights)
        moment = np.einsum('sbdi,bd->sdi', self._moment[..., pick], weights)
        place, _ = self._best_delay(gram, moment, pick, weights)
        shifts = self.fitter.prepared.shifts
        return float(shifts[0] + place * (shifts[1] - shifts[0]))

    def _held_out(
        self, gram: Floats, moment: Floats, square: Floats, pick: NDArray[np.intp]
    ) -> Floats:
        blocks, training = self.fitter.blocks, self.folds.training
        drives, m = moment.shape[1:]
        weights = self.base.weights
        all_gram = np.tensordot(training, gram * weights[:, :, None, None], axes=1)
        all_moment = np.tensordot(training, moment * weights[:, :, None], axes=1)
        out = np.zeros((FOLDS, drives, m))
        solved = self._solve(self._grouped(all_gram, 1), self._grouped(all_moment, 1), pick)
        for index, group in enumerate(self.fitter.groups):
            out[:, group] = solved[:, index, None]
        own = out[self.folds.test]
        product = np.einsum('bdij,bdj->bdi', gram, own)
        error = square + (own * (product - 2.0 * moment)).sum(axis=2)
        mse = np.maximum(error, 0.0) / blocks.counts
        return np.where(blocks.valid, mse, np.nan)

    def _grouped(self, values: Floats, axis: int) -> Floats:
        """Sums over the drives that share coefficients."""
        parts = [np.take(values, group, axis).sum(axis=axis) for group in self.fitter.groups]
        return np.stack(parts, axis=axis)

    def _solve(self, gram: Floats, moment: Floats, pick: NDArray[np.intp]) -> Floats:
        """Of all groups at once: gram [S, G, m, m] and moment [S, G, m] → [S, G, m]."""
        lower, upper, ridge = [], [], []
        for group in self.fitter.groups:
            weight = float(self.fitter.weight[list(group)].mean())
            ridge.append(weight * REDUCED_RATE / np.square(self._prior[group[0]][pick]))
            lower.append(self._lower[group][:, pick].mean(axis=0))
            upper.append(self._upper[group][:, pick].mean(axis=0))
        m = len(pick)
        low, high, prior = (
            np.broadcast_to(np.stack(x), moment.shape).reshape(-1, m)
            for x in (lower, upper, ridge)
        )
        solved = bounded_solve(gram.reshape(-1, m, m), moment.reshape(-1, m), low, high, prior)
        return solved.reshape(moment.shape)

    def _best_delay(
        self, gram: Floats, moment: Floats, pick: NDArray[np.intp], weights: Floats
    ) -> tuple[float, float]:
        square = np.einsum('sbd,bd->sd', self._square, weights)
        next_ = np.einsum('sbd,bd->sd', self._next, weights)
        coarse = self._profile(gram, moment, square, pick)
        best = int(np.clip(np.argmin(coarse), 1, len(coarse) - 2))
        places = np.linspace(best - 1, best + 1, 2 * _FINE + 1)
        moments, squares = between(places, moment, square, next_)
        fine = self._profile(gram, moments, squares, pick)
        return float(places[int(np.argmin(fine))]), float(fine.min())

    def _profile(
        self, gram: Floats, moment: Floats, square: Floats, pick: NDArray[np.intp]
    ) -> Floats:
        matrix, right = self._grouped(gram, 0), self._grouped(moment, 1)
        batch = np.broadcast_to(matrix, (len(right), *matrix.shape)).copy()
        x = self._solve(batch, right, pick)
        error = self._grouped(square, 1) - 2 * (x * right).sum(axis=2)
        error = error + np.einsum('sgi,gij,sgj->sg', x, matrix, x, optimize=True)
        size = np.array([len(group) for group in self.fitter.groups])
        return (size * np.log(np.maximum(error, 1e-9))).sum(axis=1)

    @cached_property
    def _rows(self) -> NDArray[np.intp]:
        return self.fitter.blocks.rows

    @cached_property
    def _gram(self) -> Floats:
        """Return the normal matrices [B, D, M, M]."""
        mask = self.fitter.blocks.mask.transpose(0, 2, 1)[:, :, None, :]
        x = self._columns[self._rows].transpose(0, 2, 3, 1) * mask
        return x @ x.transpose(0, 1, 3, 2)

    @cached_property
    def _targets(self) -> Floats:
        """Return the targets at each delay, W [S, B, D, L]."""
        power = self.fitter.prepared.power[:, self._rows].astype(np.float64)
        less = power - self._constant[self._rows]
        mask = self.fitter.blocks.mask
        return np.where(mask, np.nan_to_num(less), 0.0).transpose(0, 1, 3, 2)

    @cached_property
    def _moment(self) -> Floats:
        """Return the moments at each delay [S, B, D, M]."""
        x = self._columns[self._rows].transpose(0, 2, 3, 1)  # [B, D, M, L]
        y = self._targets.transpose(1, 2, 3, 0)  # [B, D, L, S]
        return (x @ y).transpose(3, 0, 1, 2)

    @cached_property
    def _square(self) -> Floats:
        return np.square(self._targets).sum(axis=3)

    @cached_property
    def _next(self) -> Floats:
        out = np.zeros_like(self._square)
        out[:-1] = (self._targets[:-1] * self._targets[1:]).sum(axis=3)
        return out


def shaped(fitter: Fitter, folds: Folds, structure: Structure) -> Structure:
    """The structure with the shape of each of its effects that fits best, one after the other."""
    signals = fitter.prepared.signals
    options = {
        active.name: [
            Active.of(active.effect, shape)
            for shape in active.effect.shapes_of(fitter.scale)
            if active.effect.usable(signals, **shape)
        ]
        for active in structure.actives
        if len(active.effect.shapes_of(fitter.scale)) > 1
    }
    if not options:
        return structure
    fixed = structure
    for name in options:
        fixed = fixed.without(name)
    screener = CandidateScreener(
        fitter, folds, fitter.fit(fixed, iterations=3), list(itertools.chain(*options.values()))
    )
    chosen = {name: shapes[0] for name, shapes in options.items()}
    for _ in range(2):
        for name, shapes in options.items():
            others = [active for other, active in chosen.items() if other != name]
            chosen[name] = min(
                shapes, key=lambda shape: screener.screen([*others, shape]).training_error
            )
    return Structure(tuple(chosen.get(active.name, active) for active in structure.actives))
