"""Linear Gaussian problems with the discrepancy marginalised: evidence, means and draws."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.special import log_ndtr, ndtr, ndtri, ndtri_exp
from wattwalk_core.arrays import Bools, Floats

_HELD = 1e-5  # spread of a coefficient that is held at 0
_SWEEPS, _WARMING = 240, 40


@dataclass(frozen=True)
class NormalEquations:
    """Normal equations at one size of the discrepancy, for S delays of the power.

    n effects and z nuisances are left; the smooth features are marginalised. With a first axis
    more, of K sizes.
    """

    spread: Floats  # prior spreads of what is marginalised: last columns, then features
    gram: Floats  # [n + z, n + z]
    moments: Floats  # [n + z, S]
    constants: Floats  # nats [S]

    def at(self, size: int | NDArray[np.bool_]) -> 'NormalEquations':
        """Return the problem at one of several sizes, or at some of them."""
        return NormalEquations(
            self.spread[size], self.gram[size], self.moments[size], self.constants[size]
        )

    def taken(self, kept: NDArray[np.intp], place: int) -> 'NormalEquations':
        """Return the problem of some of the columns alone, at one delay."""
        own = slice(place, place + 1)
        gram = self.gram[..., kept[:, None], kept]
        moments, constants = self.moments[..., kept, own], self.constants[..., own]
        return NormalEquations(self.spread, gram, moments, constants)

    def centred(self, places: NDArray[np.intp], mean: Floats, spread: Floats) -> 'NormalEquations':
        """Return the problem where coefficients at places, not negative, have prior means [k]."""
        moments = self.moments.copy()
        moments[places] += (mean / spread**2)[:, None]
        nats = 0.5 * np.square(mean / spread) + log_ndtr(mean / spread) + np.log(2.0)
        return replace(self, moments=moments, constants=self.constants - nats.sum())

    def without(self, count: int, sizes: Floats) -> 'NormalEquations':
        """Marginalise the last columns, so many, of K problems at Q prior spreads: of K·Q."""
        kept = self.gram.shape[-1] - count
        inner = self.gram[:, None, kept:, kept:] + np.multiply.outer(sizes**-2.0, np.eye(count))
        factor = np.linalg.cholesky(inner)  # [K, Q, count, count]
        joined = np.concatenate([self.gram[:, kept:, :kept], self.moments[:, kept:]], axis=2)
        solved = np.linalg.solve(factor, joined[:, None])
        left, right = solved[..., :kept], solved[..., kept:]
        nats = _log_diagonal(factor) + count * np.log(sizes)
        gain = 0.5 * np.square(right).sum(axis=-2) - nats[..., None]
        spread = np.broadcast_to(sizes[:, None], (*nats.shape, count))
        last = np.broadcast_to(self.spread[:, None], (*nats.shape, self.spread.shape[1]))
        found = (
            np.concatenate([spread, last], axis=2),
            self.gram[:, None, :kept, :kept] - left.mT @ left,
            self.moments[:, None, :kept] - left.mT @ right,
            self.constants[:, None] + gain,
        )
        return NormalEquations(*(part.reshape(nats.size, *part.shape[2:]) for part in found))


@dataclass(frozen=True)
class Solution:
    """Gaussian posterior of effects and nuisances at one delay; signed ones are not negative."""

    evidence: float  # nats
    mean: Floats  # [n + z]
    covariance: Floats  # [n + z, n + z]


@dataclass(frozen=True)
class Standing:
    """Weighted columns that stand beside all sets: of absent effects, then the discrepancy's.

    The discrepancy's features are turned so that their products are diagonal.
    """

    columns: Floats  # [N, c + a]
    gram: Floats  # [c, c + a], of the absent ones with all
    values: Floats  # [a], squared lengths of the features
    turn: Floats  # [a, a], from weights of these to weights of the features as they were
    power: Floats  # weighted, at S delays [N, S]
    moments: Floats  # [c + a, S]

    @classmethod
    def of(cls, features: Floats, power: Floats, absent: Floats | None = None) -> 'Standing':
        """Turn weighted features [N, a] beside weighted power [N, S] and absent effects [N, c]."""
        values, turn = np.linalg.eigh(features.T @ features)
        first = np.empty((len(features), 0)) if absent is None else absent
        columns = np.concatenate([first, features @ turn], axis=1)
        gram = first.T @ columns
        return cls(columns, gram, np.maximum(values, 0.0), turn, power, columns.T @ power)

    def beside(
        self, columns: Floats, constant: Floats, absent: NDArray[np.intp] | None = None
    ) -> 'Weighed':
        """Weighted products with columns [N, m], where a part of the power [N] is known.

        absent: places of the absent effects that count as columns, behind the others.
        """
        places = np.empty(0, np.intp) if absent is None else absent
        features = slice(len(self.gram), None)
        error = self.power - constant[:, None]
        products = self.columns.T @ np.concatenate([columns, constant[:, None]], axis=1)
        cross, moments = products[:, :-1], self.moments - products[:, -1:]
        of_absent = self.gram[np.ix_(places, places)]
        return Weighed(
            np.block([[columns.T @ columns, cross[places].T], [cross[places], of_absent]]),
            np.concatenate([columns.T @ error, moments[places]]),
            np.square(error).sum(axis=0),
            self.values,
            np.concatenate([cross[features], self.gram[places, features].T], axis=1),
            moments[features],
        )


@dataclass(frozen=True)
class Weighed:
    """Weighted products of columns [m] with one another and with the power at S delays.

    Beside them stand the turned features of the discrepancy [a], where there are any left.
    """

    gram: Floats  # [m, m]
    moments: Floats  # [m, S]
    squares: Floats  # of the power [S]
    values: Floats  # [a]
    cross: Floats  # [a, m]
    turned: Floats  # [a, S]

    def at_sizes(self, sizes: Floats) -> NormalEquations:
        """Marginalise the features at each of K prior spreads."""
        scale = 1.0 / (self.values + sizes[:, None] ** -2.0)  # [K, a]
        heavy = self.cross.T * scale[:, None, :]
        squares = self.squares - scale @ np.square(self.turned)
        nats = 0.5 * np.log1p(self.values * sizes[:, None] ** 2).sum(axis=1)
        return NormalEquations(
            np.broadcast_to(sizes[:, None], scale.shape),
            self.gram - heavy @ self.cross,
            self.moments - heavy @ self.turned,
            -0.5 * squares - nats[:, None],
        )

    def smooth(self, normal: 'NormalEquations', mean: Floats, place: int) -> Floats:
        """Mean weights of the smooth features beside effects and nuisances [n + z].

        Those of the columns that are not kept come first, then those of the turned features.
        """
        count = len(mean)
        inner = np.block([[self.gram, self.cross.T], [self.cross, np.diag(self.values)]])
        moments = np.concatenate([self.moments, self.turned])[count:, place]
        precision = inner[count:, count:] + np.diag(normal.spread**-2.0)
        return np.asarray(np.linalg.solve(precision, moments - inner[count:, :count] @ mean))

    def covariance(self, spread: Floats) -> Floats:
        """Posterior covariance of columns, then turned features, with prior spreads [m + a]."""
        inner = np.block([[self.gram, self.cross.T], [self.cross, np.diag(self.values)]])
        return np.asarray(np.linalg.inv(inner + np.diag(spread**-2.0)))


def marginalised(
    weighed: Weighed, groups: tuple[int, int], sizes: tuple[Floats, Floats]
) -> NormalEquations:
    """Marginalise the features, and the last columns in two groups of so many.

    sizes: prior spreads of the features and of the first group, all of which are tried; the
    second group's is 1.
    """
    bent, absent = groups
    return weighed.at_sizes(sizes[0]).without(absent, np.ones(1)).without(bent, sizes[1])


def by_delay(normal: NormalEquations, sizes: Floats) -> Floats:
    """Log evidence at each delay [S], or [K, S] of several sizes, at prior spreads [n + z]."""
    factor = np.linalg.cholesky(normal.gram + np.diag(sizes**-2.0))
    half = _log_diagonal(factor) + np.log(sizes).sum()
    found = np.linalg.solve(factor, normal.moments)
    return np.asarray(normal.constants + 0.5 * np.square(found).sum(axis=-2) - half[..., None])


def _log_diagonal(factor: NDArray[Any]) -> Floats:
    """Log of the determinant of triangular matrices [..., n, n]."""
    return np.asarray(np.log(np.diagonal(factor, axis1=-2, axis2=-1)).sum(axis=-1))


def solved(normal: NormalEquations, place: int, sizes: Floats, signed: Bools) -> Solution:
    """Solve at one delay; signed coefficients [n] are held at 0 where they would be negative.

    Of two that a recording hardly tells apart, free ones of opposite sign would mislead the next
    linearisation.
    """
    sizes = sizes.copy()
    moment, count = normal.moments[:, place], len(signed)
    while True:
        factor = np.linalg.cholesky(normal.gram + np.diag(sizes**-2.0))
        root = solve_triangular(factor, np.eye(len(factor)), lower=True, check_finite=False)
        covariance = root.T @ root
        mean = covariance @ moment
        below = np.flatnonzero(signed & (mean[:count] < 0) & (sizes[:count] > 2 * _HELD))
        if not below.size:
            break
        shown = mean[below] / np.sqrt(np.diag(covariance)[below])
        sizes[below[np.argmin(shown)]] = _HELD
    half = np.log(np.diag(factor)).sum() + np.log(sizes).sum()
    log = float(normal.constants[place] + 0.5 * moment @ mean - half)
    shown = mean[:count] / np.sqrt(np.diag(covariance)[:count])
    log += float((log_ndtr(shown) + np.log(2.0))[signed].sum())
    return Solution(log, mean, covariance)


def draws(
    normal: NormalEquations,
    place: int,
    sizes: Floats,
    start: Floats,
    signed: Bools,
    random: np.random.Generator,
    share: float = 1.0,
) -> Floats:
    """Draw effects and nuisances [s, n + z], signed ones from the part that is not negative.

    share: of the draws that a posterior has, those of this part of it.

    Gibbs steps from start [n + z] along the columns of the covariance's root, which are
    independent but for the ends.
    """
    precision = normal.gram + np.diag(sizes**-2.0)
    covariance = np.linalg.inv(precision)
    mean, count = covariance @ normal.moments[:, place], len(signed)
    own = covariance[:count, :count]
    root = np.linalg.cholesky(own)
    values = np.where(signed, np.maximum(start[:count], _HELD), start[:count])
    white = solve_triangular(root, values - mean[:count], lower=True)
    sweeps = max(1, round(share * _SWEEPS))
    kept = np.empty((sweeps, count))
    for sweep in range(-_WARMING, sweeps):
        for i in range(count):
            way = root[:, i]
            rest = values - way * white[i]
            low, high = _reach(-rest[signed], way[signed])
            white[i] = _between(low, high, random)
            values = rest + way * white[i]
        if sweep >= 0:
            kept[sweep] = values
    inverse = np.linalg.inv(own)
    other = covariance[count:, :count] @ inverse
    rest = covariance[count:, count:] - other @ covariance[:count, count:]
    spread = np.linalg.cholesky(
        rest + 1e-10 * np.trace(rest) / max(len(rest), 1) * np.eye(len(rest))
    )
    nuisance = mean[count:] + (kept - mean[:count]) @ other.T
    nuisance = nuisance + random.normal(size=nuisance.shape) @ spread.T
    return np.concatenate([kept, nuisance], axis=1)


def _reach(least: Floats, way: Floats) -> tuple[float, float]:
    """Ends between which steps along a way [k] stay at or above their least values [k]."""
    up, down = way > 1e-12, way < -1e-12
    low = float((least[up] / way[up]).max()) if up.any() else -np.inf
    high = float((least[down] / way[down]).min()) if down.any() else np.inf
    return min(low, high), max(low, high)


def _between(low: float, high: float, random: np.random.Generator) -> float:
    """Draw from a standard normal between two ends, also far out."""
    if low > 0.0 or high < 0.0:
        side = 1.0 if low > 0.0 else -1.0
        near, far = (low, high) if low > 0.0 else (-high, -low)
        beyond = float(log_ndtr(-near))
        up_to_far = -np.expm1(float(log_ndtr(-far)) - beyond)  # of what is beyond the near end
        kept = beyond + float(np.log1p(-up_to_far * (1.0 - random.random())))
        return -side * min(max(float(ndtri_exp(kept)), -far), -near)
    below, above = ndtr(low), ndtr(high)
    return float(np.clip(ndtri(below + (above - below) * random.random()), low, high))
