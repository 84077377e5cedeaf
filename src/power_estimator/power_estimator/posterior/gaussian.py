"""Linear Gaussian problems with the discrepancy marginalised: evidence, means and draws."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.special import log_ndtr, ndtr, ndtri
from wattwalk_core.arrays import Bools, Floats

_HELD = 1e-5  # spread of a coefficient that is held at 0
_SWEEPS, _WARMING = 240, 40
_FAR = 6.0  # standard deviations


@dataclass(frozen=True)
class NormalEquations:
    """Normal equations at one size of the discrepancy, for S delays of the power.

    n effects and z nuisances are left; the smooth features are marginalised.
    """

    spread: Floats  # prior spreads of what is marginalised: last columns, then features
    gram: Floats  # [n + z, n + z]
    moments: Floats  # [n + z, S]
    constants: Floats  # nats [S]

    def taken(self, kept: NDArray[np.intp], place: int) -> 'NormalEquations':
        """Return the problem of some of the columns alone, at one delay."""
        own = slice(place, place + 1)
        gram = self.gram[np.ix_(kept, kept)]
        return NormalEquations(self.spread, gram, self.moments[kept, own], self.constants[own])


@dataclass(frozen=True)
class Solution:
    """Gaussian posterior of effects and nuisances at one delay; signed ones are not negative."""

    evidence: float  # nats
    mean: Floats  # [n + z]
    covariance: Floats  # [n + z, n + z]


@dataclass(frozen=True)
class Turned:
    """Weighted features of the discrepancy, turned so that their products are diagonal."""

    features: Floats  # [N, a]
    values: Floats  # [a], their squared lengths
    turn: Floats  # [a, a], from weights of these to weights of the features as they were
    power: Floats  # weighted, at S delays [N, S]
    moments: Floats  # [a, S]

    @classmethod
    def of(cls, features: Floats, power: Floats) -> 'Turned':
        """Turn weighted features [N, a] beside weighted power [N, S]."""
        values, turn = np.linalg.eigh(features.T @ features)
        turned = features @ turn
        return cls(turned, np.maximum(values, 0.0), turn, power, turned.T @ power)

    def beside(self, columns: Floats, constant: Floats) -> 'Weighed':
        """Weighted products with columns [N, m], where a part of the power [N] is known."""
        error = self.power - constant[:, None]
        cross = self.features.T @ np.concatenate([columns, constant[:, None]], axis=1)
        return Weighed(
            columns.T @ columns,
            columns.T @ error,
            np.square(error).sum(axis=0),
            self.values,
            cross[:, :-1],
            self.moments - cross[:, -1:],
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

    def at_size(self, size: float) -> tuple['Weighed', float]:
        """Marginalise the features at a prior spread, with the nats that this costs."""
        scale = 1.0 / (self.values + size**-2.0)
        heavy = self.cross.T * scale
        left = Weighed(
            self.gram - heavy @ self.cross,
            self.moments - heavy @ self.turned,
            self.squares - scale @ np.square(self.turned),
            self.values[:0],
            self.cross[:0],
            self.turned[:0],
        )
        return left, float(0.5 * np.log1p(self.values * size**2).sum())

    def without(self, count: int, size: float) -> tuple['Weighed', float]:
        """Marginalise the last columns, so many, of one prior spread, with the nats."""
        kept = len(self.gram) - count
        factor = np.linalg.cholesky(self.gram[kept:, kept:] + np.eye(count) / size**2)
        joined = np.concatenate([self.gram[kept:, :kept], self.moments[kept:]], axis=1)
        solved = solve_triangular(factor, joined, lower=True, check_finite=False)
        left, right = solved[:, :kept], solved[:, kept:]
        rest = replace(
            self,
            gram=self.gram[:kept, :kept] - left.T @ left,
            moments=self.moments[:kept] - left.T @ right,
            squares=self.squares - np.square(right).sum(axis=0),
        )
        return rest, float(np.log(np.diag(factor)).sum() + count * np.log(size))

    def smooth(self, normal: 'NormalEquations', mean: Floats, place: int) -> Floats:
        """Mean weights of the smooth features beside effects and nuisances [n + z].

        Those of the columns that are not kept come first, then those of the turned features.
        """
        count = len(mean)
        inner = np.block([[self.gram, self.cross.T], [self.cross, np.diag(self.values)]])
        moments = np.concatenate([self.moments, self.turned])[count:, place]
        precision = inner[count:, count:] + np.diag(normal.spread**-2.0)
        return np.asarray(np.linalg.solve(precision, moments - inner[count:, :count] @ mean))


def marginalised(
    weighed: Weighed, groups: tuple[int, int], sizes: tuple[Floats, Floats]
) -> list[NormalEquations]:
    """Marginalise the features, and the last columns in two groups of so many.

    sizes: prior spreads of the features and of the first group, all of which are tried; the
    second group's is 1.
    """
    bent, absent = groups
    out = []
    for first in sizes[0]:
        there, most = weighed.at_size(first)
        there, nats = there.without(absent, 1.0)
        for second in sizes[1]:
            left, more = there.without(bent, second)
            spread = np.repeat([second, 1.0, first], [bent, absent, len(weighed.values)])
            constants = np.asarray(-0.5 * left.squares - nats - more - most)
            out.append(NormalEquations(spread, left.gram, left.moments, constants))
    return out


def by_delay(normal: NormalEquations, sizes: Floats) -> Floats:
    """Log evidence at each delay [S], at prior spreads [n + z]."""
    factor = np.linalg.cholesky(normal.gram + np.diag(sizes**-2.0))
    half = np.log(np.diag(factor)).sum() + np.log(sizes).sum()
    found = solve_triangular(factor, normal.moments, lower=True, check_finite=False)
    return np.asarray(normal.constants + 0.5 * np.square(found).sum(axis=0) - half)


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
        if near > _FAR:  # the tail is all but exponential
            return side * min(near + random.exponential() / near, far)
        upper, lower = ndtr(-near), ndtr(-far)
        return -side * float(ndtri(lower + (upper - lower) * random.random()))
    below, above = ndtr(low), ndtr(high)
    return float(np.clip(ndtri(below + (above - below) * random.random()), low, high))
