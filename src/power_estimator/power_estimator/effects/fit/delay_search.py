"""Search for the delay of the power against the joint signals, common to all drives."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from wattwalk_core.arrays import Floats

from power_estimator.effects.fit.blocks import Blocks, DelayedNormal, Normal, between
from power_estimator.effects.fit.bounded_lsq import bounded_solve
from power_estimator.effects.fit.design import Design
from power_estimator.effects.fit.settings import FitSettings
from power_estimator.effects.signals.prepared import Prepared
from power_estimator.effects.signals.reducer import REDUCED_RATE, SHIFT_STEP


@dataclass(frozen=True)
class DelaySearch:
    """Search for the delay of the power against the joint signals in s, one for all drives.

    Positive where the power is stamped late. The best delay leaves the least sum over drives of
    the log of their group's squared residuals, with coefficients solved within their bounds at
    each delay.
    """

    prepared: Prepared
    groups: Sequence[list[int]]  # drives that share coefficients
    weight: Floats  # W² [D], of the priors
    settings: FitSettings

    def found(
        self,
        design: Design,
        blocks: Blocks,
        weights: Floats,
        near: float | None,
        delay: float | None,
    ) -> tuple[Normal, float]:
        """Return normal equations at the best delay, and that delay in s.

        weights: of the blocks [B, D]; near: a delay in s about which it is sought first. With
        delay nothing is sought, nor in operating points, whose delay is 0.
        """
        if self.prepared.steady:
            delay = 0.0
        shifts = self.prepared.shifts
        if delay is not None:
            place = np.clip((delay - shifts[0]) / SHIFT_STEP, 0.0, len(shifts) - 1.001)
            low = int(place)
            return self._equations(design, blocks, slice(low, low + 2)).at(place - low), delay
        window = self._window(near)
        equations = self._equations(design, blocks, window)
        sums = equations.summed(weights)
        best = int(np.argmin(self._profile(design, *sums[:3])))
        inner = (best > 0 or window.start == 0) and (
            best < len(sums[1]) - 1 or window.stop == len(shifts)
        )
        if not inner:
            return self.found(design, blocks, weights, None, None)
        place = self._finely(design, sums, best)
        return equations.at(place), float(shifts[0] + SHIFT_STEP * (window.start + place))

    def drawn(
        self, design: Design, blocks: Blocks, weights: Floats, near: float, drawn: Floats
    ) -> Floats:
        """Return the best delays in s [R], about `near`, of R bootstraps of the blocks.

        drawn [R, B]: how often each block counts; weights [B, D].
        """
        out = np.zeros(len(drawn))
        if self.prepared.steady:
            return out
        window = self._window(near)
        equations = self._equations(design, blocks, window)
        for row, counts in enumerate(drawn):
            sums = equations.summed(weights * counts[:, None])
            best = int(np.argmin(self._profile(design, *sums[:3])))
            place = window.start + self._finely(design, sums, best)
            out[row] = self.prepared.shifts[0] + SHIFT_STEP * place
        return out

    def _window(self, near: float | None) -> slice:
        count = len(self.prepared.shifts)
        if near is None:
            return slice(0, count)
        middle = round((near - float(self.prepared.shifts[0])) / SHIFT_STEP)
        beside = self.settings.near_delays
        low = int(np.clip(middle - beside, 0, count - 2 * beside - 1))
        return slice(low, low + 2 * beside + 1)

    def _equations(self, design: Design, blocks: Blocks, window: slice) -> DelayedNormal:
        power = self.prepared.power[window]
        return DelayedNormal.of(design.columns, power, design.constant, blocks)

    def _finely(
        self, design: Design, sums: tuple[Floats, Floats, Floats, Floats], best: int
    ) -> float:
        """Place of the best delay between the neighbours of the best of some."""
        gram, moment, square, next_ = sums
        middle = int(np.clip(best, 1, len(moment) - 2))
        steps = round(SHIFT_STEP / self.settings.fine_delay)
        places = np.linspace(middle - 1, middle + 1, 2 * steps + 1)
        fine = self._profile(design, gram, *between(places, moment, square, next_))
        return float(places[int(np.argmin(fine))])

    def _profile(self, design: Design, gram: Floats, moment: Floats, square: Floats) -> Floats:
        """Summed log error [S] at S delays; the search begins at the bounds of the middle one."""
        prior = design.structure.priors(self.prepared.scale)
        limits = group_limits(design, prior, self.weight, self.groups)
        matrix = summed(gram, self.groups, 0)  # [G, m, m]
        right = summed(moment, self.groups, 1)  # [S, G, m]
        squares = summed(square, self.groups, 1)
        near = bounded_solve(matrix, right[len(right) // 2], *limits)
        count, m = len(right), matrix.shape[1]
        every = [np.tile(values, (count, 1)) for values in (*limits, near)]
        x = bounded_solve(np.tile(matrix, (count, 1, 1)), right.reshape(-1, m), *every)
        x = x.reshape(right.shape)
        error = squares - 2 * (x * right).sum(axis=2)
        error = error + ((matrix @ x[..., None])[..., 0] * x).sum(axis=2)
        size = np.array([len(group) for group in self.groups])
        total: Floats = (size * np.log(np.maximum(error, 1e-9))).sum(axis=1)
        return total


def summed(values: Floats, groups: Sequence[list[int]], axis: int) -> Floats:
    """Return sums over the drives of each group, which lie along an axis of the values."""
    return np.stack([np.take(values, own, axis).sum(axis=axis) for own in groups], axis=axis)


def group_limits(
    design: Design, prior: Floats, weight: Floats, groups: Sequence[list[int]]
) -> tuple[Floats, Floats, Floats]:
    """Return lower and upper bounds and the weight of the prior of each group of drives, [G, m].

    prior: standard deviation [D, m]; weight: W² [D]; groups: columns of drives, which share
    coefficients.
    """
    return limits_of(design.lower, design.upper, prior, weight, groups)


def limits_of(
    lower: Floats, upper: Floats, prior: Floats, weight: Floats, groups: Sequence[list[int]]
) -> tuple[Floats, Floats, Floats]:
    """Return what `group_limits` does, of bounds [D, m]."""
    means = [np.stack([bound[own].mean(axis=0) for own in groups]) for bound in (lower, upper)]
    ridge = [weight[own].mean() * REDUCED_RATE / np.square(prior[own[0]]) for own in groups]
    return means[0], means[1], np.stack(ridge)
