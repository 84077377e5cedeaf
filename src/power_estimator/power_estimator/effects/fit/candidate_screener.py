"""All candidate effects in all their shapes, linearised about one fit: any subset at no cost."""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.arrays import Bools, Floats

from power_estimator.effects.fit.blocks import between, for_each, neighbours
from power_estimator.effects.fit.bounded_lsq import bounded_solve
from power_estimator.effects.fit.delay_search import limits_of, summed
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.effects.fit.fitter import Fit, Fitter
from power_estimator.effects.fit.folds import Folds
from power_estimator.effects.fit.orders import PERIODIC, orders_of_fit
from power_estimator.effects.signals.reducer import SHIFT_STEP

Item = TypeVar('Item')


@dataclass(frozen=True)
class Screened:
    """Held-out errors of a subset of the candidates on top of the base."""

    actives: tuple[Active, ...]
    mse: Floats  # W² [B, D], NaN where not measured
    loss: float  # mean over blocks of the summed log error
    training_error: float  # summed log of the error of the fit to everything
    delay: float  # s

    @property
    def mean_mse(self) -> Floats:
        """Held-out mean squared error of each drive over its measured blocks, W² [D]."""
        return np.nanmean(self.mse, axis=0)


@dataclass(frozen=True)
class Trial:
    """A subset of the candidates fitted to all blocks, at its best delay."""

    actives: tuple[Active, ...]
    columns: NDArray[np.intp]  # of the base and the subset, filled up with the empty column
    place: float  # of the delay among those of the power
    error: float  # summed log
    solution: Floats  # of each group [G, m]


class CandidateScreener:
    """Screens subsets of candidate effects on top of a fit, the base, without new designs.

    All columns are linearised once about the base. folds: of the cross-validation.
    """

    def __init__(
        self, fitter: Fitter, folds: Folds, base: Fit, candidates: Sequence[Active]
    ) -> None:
        self.fitter, self.folds, self.base = fitter, folds, base
        self.candidates = tuple(candidates)
        self._own = base.coefficients.shape[1]
        ends = self._own + np.cumsum([len(a.effect.terms) for a in self.candidates])
        self._place = {
            active.key: list(range(int(end) - len(active.effect.terms), int(end)))
            for active, end in zip(self.candidates, ends, strict=True)
        }
        self._empty = int(ends[-1]) if len(ends) else self._own
        self._limits()
        self._linearise()
        self._sum()

    def screen(self, actives: Sequence[Active] = ()) -> Screened:
        """Return held-out errors of the base with these candidates, at their best delay."""
        return self.screened([actives])[0]

    def screened(self, subsets: Sequence[Sequence[Active]]) -> list[Screened]:
        """Return held-out errors of the base with each subset of the candidates."""
        return self.tested(self.fitted(subsets))

    def fitted(self, subsets: Sequence[Sequence[Active]]) -> list[Trial]:
        """Fit the base with each subset of the candidates to all blocks."""
        found = []
        for some in self._batches(subsets):
            picks = [
                [*range(self._own), *itertools.chain(*(self._place[a.key] for a in actives))]
                for actives in some
            ]
            width = max(map(len, picks))
            pick = np.array([own + [self._empty] * (width - len(own)) for own in picks])
            places, errors, solutions = self._best_delays(pick)
            rows = zip(some, pick, places.tolist(), errors.tolist(), solutions, strict=True)
            found += [Trial(tuple(actives), *rest) for actives, *rest in rows]
        return found

    def tested(self, trials: Sequence[Trial]) -> list[Screened]:
        """Return held-out errors of each trial, at its delay."""
        first = float(self.fitter.prepared.shifts[0])
        out = []
        for some in self._batches(trials):
            mse = self._held_out(some)
            for trial, own in zip(some, mse, strict=True):
                delay = first + trial.place * SHIFT_STEP
                logs = np.log(own + self.fitter.settings.least_mse)
                loss = float(np.nansum(logs, axis=1).mean())
                out.append(Screened(trial.actives, own, loss, trial.error, delay))
        return out

    def _batches(self, items: Sequence[Item]) -> Iterator[Sequence[Item]]:
        settings = self.fitter.settings
        delays = 2 * settings.screened_delays
        problem = len(self.fitter.groups) * delays * (self._own + 8) ** 2
        size = max(1, settings.screened_together // problem)
        for start in range(0, len(items), size):
            yield items[start : start + size]

    def _limits(self) -> None:
        """Bounds and priors of all columns, of each group of drives."""
        scale, base = self.fitter.scale, self.base
        lower, upper = base.structure.bounds(base.coefficients, scale)
        prior = [base.structure.priors(scale)]
        for active in self.candidates:
            alone = Structure((active,))
            ends = alone.bounds(np.zeros((len(lower), len(active.effect.terms))), scale)
            lower = np.concatenate([lower, ends[0]], axis=1)
            upper = np.concatenate([upper, ends[1]], axis=1)
            prior.append(alone.priors(scale))
        priors, groups = np.concatenate(prior, axis=1), self.fitter.groups
        limits = limits_of(lower, upper, priors, self.fitter.weight, groups)
        self._lower, self._upper, self._ridge = (
            np.pad(values, ((0, 0), (0, 1))) for values in limits
        )

    def _linearise(self) -> None:
        """Columns of the base and of all candidates [N, D, M], the last one empty."""
        builder, base = self.fitter.builder, self.base
        design = builder.build(base.structure, base.coefficients, keep=True)
        self._constant = design.constant
        count, drives = design.constant.shape
        self._columns = np.zeros((count, drives, self._empty + 1), np.float32)
        self._columns[..., : self._own] = design.columns
        beside = builder.beside(self.candidates, base.structure, base.coefficients)
        for active, columns in zip(self.candidates, beside, strict=True):
            self._columns[..., self._place[active.key]] = columns

    def _sum(self) -> None:
        """Weighted normal equations of everything, and of the training part of each fold."""
        prepared, blocks = self.fitter.prepared, self.fitter.blocks
        drives, m = self._columns.shape[1:]
        shifts = len(prepared.shifts)
        self._gram = np.zeros((1 + self.folds.count, drives, m, m))
        self._moment = np.zeros((1 + self.folds.count, shifts, drives, m))
        self._square, self._next = np.zeros((shifts, drives)), np.zeros((shifts, drives))
        rows = blocks.rows
        masks = blocks.mask

        def fill(drive: int) -> None:
            root = np.sqrt(self.base.weights[:, drive, None]) * masks[..., drive]
            x = self._columns[rows, drive].astype(np.float64) * root[..., None]
            y = prepared.power[:, rows, drive] - self._constant[rows, drive]
            y = np.nan_to_num(y) * root  # [S, B, L]
            self._square[:, drive] = np.einsum('sbl,sbl->s', y, y)
            self._next[:-1, drive] = np.einsum('sbl,sbl->s', y[:-1], y[1:])

            def sums(used: Bools) -> list[Floats]:
                flat = x[used].reshape(-1, x.shape[2])
                return [flat.T @ flat, y[:, used].reshape(len(y), -1) @ flat]

            gram, moment = sums(np.ones(len(rows), bool))
            self._gram[0, drive], self._moment[0, :, drive] = gram, moment
            for fold in range(self.folds.count):
                out_gram, out_moment = sums(self.folds.training[fold] == 0)
                self._gram[1 + fold, drive] = gram - out_gram
                self._moment[1 + fold, :, drive] = moment - out_moment

        for_each(fill, range(drives))

    def _solve(self, gram: Floats, moment: Floats, pick: NDArray[np.intp], near: Floats) -> Floats:
        """Solve subsets [n] of groups [G]: gram [n, P, G, m, m]; moment, near [n, P, G, m]."""
        m = pick.shape[1]
        lower, upper, ridge = (
            np.broadcast_to(values[:, pick].transpose(1, 0, 2)[:, None], moment.shape)
            for values in (self._lower, self._upper, self._ridge)
        )
        full = np.broadcast_to(gram, (*moment.shape, m)).reshape(-1, m, m)
        begin = np.broadcast_to(near, moment.shape).reshape(-1, m)
        b, low, high, soft = (values.reshape(-1, m) for values in (moment, lower, upper, ridge))
        return bounded_solve(full, b, low, high, soft, begin).reshape(moment.shape)

    def _best_delays(self, pick: NDArray[np.intp]) -> tuple[Floats, Floats, Floats]:
        """Of each subset [n] the place of its best delay, its error there and the solution."""
        gram = self._gram[0][:, pick[:, :, None], pick[:, None, :]].transpose(1, 0, 2, 3)
        gram = summed(gram, self.fitter.groups, 1)[:, None]  # [n, 1, G, m, m]
        shifts = self.fitter.prepared.shifts
        known = round((self.base.delay - float(shifts[0])) / SHIFT_STEP)
        settings = self.fitter.settings
        beside = settings.near_delays
        middle = int(np.clip(known, beside, len(shifts) - beside - 1))
        means = [self.base.coefficients[group].mean(axis=0) for group in self.fitter.groups]
        free = 0.5 * (self._lower + np.minimum(self._upper, 1.0))
        base = np.concatenate([np.stack(means), free[:, self._own :]], axis=1)
        near = base[:, pick].transpose(1, 0, 2)[:, None]
        at_middle = np.full((len(pick), 1), float(middle))
        _, near = self._profile(gram, at_middle, pick, near)
        around = np.arange(middle - beside, middle + beside + 1, dtype=np.float64)
        coarse, _ = self._profile(gram, np.tile(around, (len(pick), 1)), pick, near)
        best = around[coarse.argmin(axis=1)]
        edge = (best == around[0]) & (best > 0) | (best == around[-1]) & (best < len(shifts) - 1)
        if edge.any():
            everywhere = np.tile(np.arange(len(shifts), dtype=np.float64), (int(edge.sum()), 1))
            coarse, _ = self._profile(gram[edge], everywhere, pick[edge], near[edge])
            best[edge] = coarse.argmin(axis=1)
        best = np.clip(best, 1, len(shifts) - 2)
        places = best[:, None] + np.linspace(-1.0, 1.0, 2 * settings.screened_delays + 1)
        fine, solved = self._profile(gram, places, pick, near)
        index, rows = fine.argmin(axis=1), np.arange(len(pick))
        return places[rows, index], fine[rows, index], solved[rows, index]

    def _profile(
        self, gram: Floats, places: Floats, pick: NDArray[np.intp], near: Floats
    ) -> tuple[Floats, Floats]:
        """Summed log error [n, P] at places [n, P] of the delay, and solutions [n, P, G, m]."""
        moment, square = between(places, self._moment[0], self._square, self._next)
        own = np.take_along_axis(moment, pick[:, None, None, :], axis=3)  # [n, P, D, m]
        right = summed(own, self.fitter.groups, 2)
        square = summed(square, self.fitter.groups, 2)
        x = self._solve(gram, right, pick, near)
        error = square - 2 * (x * right).sum(axis=3)
        error = error + (x * (gram @ x[..., None])[..., 0]).sum(axis=3)
        size = np.array([len(group) for group in self.fitter.groups])
        return (size * np.log(np.maximum(error, 1e-9))).sum(axis=2), x

    def _held_out(self, trials: Sequence[Trial]) -> Floats:
        """W² [n, B, D]: error of each block with the coefficients of its own fold."""
        blocks, prepared = self.fitter.blocks, self.fitter.prepared
        width = max(len(trial.columns) for trial in trials)
        empty = self._empty
        pick = np.array([[*t.columns, *[empty] * (width - len(t.columns))] for t in trials])
        solutions = [trial.solution for trial in trials]
        near = np.stack([np.pad(x, ((0, 0), (0, width - x.shape[1]))) for x in solutions])[:, None]
        places = np.array([trial.place for trial in trials])
        left, weight = neighbours(places, len(prepared.shifts))
        gram = self._gram[1:][:, :, pick[:, :, None], pick[:, None, :]]  # [F, D, n, m, m]
        gram = summed(gram.transpose(2, 0, 1, 3, 4), self.fitter.groups, 2)
        by_delay = self._moment[1:].swapaxes(0, 1)  # [S, F, D, M]
        w = weight[:, None, None, None]
        moment = (1 - w) * by_delay[left] + w * by_delay[left + 1]  # [n, F, D, M]
        own = np.take_along_axis(moment, pick[:, None, None, :], axis=3)
        right = summed(own, self.fitter.groups, 2)
        solved = self._solve(gram, right, pick, near)  # [n, F, G, m]
        drives = self._columns.shape[1]
        full = np.zeros((len(trials), self.folds.count, drives, empty + 1))
        for index, group in enumerate(self.fitter.groups):
            for drive in group:
                np.put_along_axis(full[:, :, drive], pick[:, None], solved[:, :, index], axis=2)
        full[..., empty] = 0.0
        out = np.full((len(trials), len(blocks.starts), drives), np.nan)
        masks = blocks.mask

        def fill(drive: int) -> None:
            for fold in range(self.folds.count):
                tested = np.flatnonzero((self.folds.test == fold) & blocks.valid[:, drive])
                rows = blocks.rows[tested]
                x = self._columns[rows, drive].reshape(-1, empty + 1)
                model = (x @ full[:, fold, drive].T.astype(np.float32)).reshape(*rows.shape, -1)
                mask, counts = masks[tested, :, drive], blocks.counts[tested, drive]
                constant = self._constant[rows, drive]
                for trial, (before, share) in enumerate(zip(left, weight, strict=True)):
                    power = (1 - share) * prepared.power[before, rows, drive]
                    power = power + share * prepared.power[before + 1, rows, drive]
                    error = np.square(np.nan_to_num(power - constant) - model[..., trial]) * mask
                    out[trial, tested, drive] = error.sum(axis=1) / counts

        for_each(fill, range(drives))
        return out


def shaped(fitter: Fitter, folds: Folds, structure: Structure) -> Structure:
    """Return the structure with the best fitting shape of each effect that leaves it open."""
    signals = fitter.prepared.signals
    options = {
        active.name: [Active.of(active.effect, shape) for shape in active.effect.tried_on(signals)]
        for active in structure.actives
        if len(active.effect.shapes_of(fitter.scale)) > 1
    }
    if not options:
        return structure
    fixed = Structure(tuple(active for active in structure.actives if active.name not in options))
    for cogging in (active for active in structure.actives if active.name == PERIODIC):
        without = fitter.fit(structure.without(PERIODIC), iterations=3)
        found = orders_of_fit(without).shapes(cogging.effect, signals)
        each = (cogging, *(Active.of(cogging.effect, shape) for shape in found))
        options[PERIODIC] = list(dict.fromkeys((*each, *options[PERIODIC])))
    screener = CandidateScreener(
        fitter, folds, fitter.fit(fixed, iterations=3), list(itertools.chain(*options.values()))
    )
    chosen = {name: shapes[0] for name, shapes in options.items()}
    for _ in range(2):
        for name, shapes in options.items():
            others = [active for other, active in chosen.items() if other != name]
            trials = screener.fitted([[*others, shape] for shape in shapes])
            chosen[name] = shapes[min(range(len(shapes)), key=lambda i: trials[i].error)]
    return Structure(tuple(chosen.get(active.name, active) for active in structure.actives))
