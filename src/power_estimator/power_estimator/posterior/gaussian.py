"""Linear Gaussian problems with the discrepancy marginalised: evidence, means and draws."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.special import log_ndtr, ndtr, ndtri

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
_HELD = 1e-5  # spread of a coefficient that is held at 0
_SWEEPS, _WARMING = 240, 40
_FAR = 6.0  # standard deviations


@dataclass(frozen=True)
class NormalEquations:
    """Normal equations at one size of the discrepancy, for S delays of the power.

    n effects and z nuisances are left; the smooth features are marginalised.
    """

    spread: Floats  # [a] of the smooth features
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
class Weighed:
    """Weighted products of columns [m] with one another and with the power at S delays."""

    gram: Floats  # [m, m]
    moments: Floats  # [m, S]
    squares: Floats  # of the power [S]

    def without(self, own: slice, size: float) -> tuple['Weighed', float]:
        """Marginalise columns of one prior spread, with the nats that this costs."""
        inner = self.gram[own, own] + np.eye(own.stop - own.start) / size**2
        factor = np.linalg.cholesky(inner)
        rest = np.r_[0 : own.start, own.stop : len(self.gram)]
        joined = np.concatenate([self.gram[own, rest], self.moments[own]], axis=1)
        solved = solve_triangular(factor, joined, lower=True)
        left, right = solved[:, : len(rest)], solved[:, len(rest) :]
        return Weighed(
            self.gram[np.ix_(rest, rest)] - left.T @ left,
            self.moments[rest] - left.T @ right,
            self.squares - np.square(right).sum(axis=0),
        ), float(np.log(np.diag(factor)).sum() + len(inner) * np.log(size))

    def at_sizes(self, count: int, sizes: Floats) -> Iterator['tuple[Weighed, float]']:
        """Marginalise all columns but the first count, at each of some prior spreads."""
        values, turned = np.linalg.eigh(self.gram[count:, count:])
        values = np.maximum(values, 0.0)
        left, right = turned.T @ self.gram[count:, :count], turned.T @ self.moments[count:]
        for size in sizes:
            scale = 1.0 / (values + size**-2.0)
            heavy = left.T * scale
            yield (
                Weighed(
                    self.gram[:count, :count] - heavy @ left,
                    self.moments[:count] - heavy @ right,
                    self.squares - scale @ np.square(right),
                ),
                float(0.5 * np.log1p(values * size**2).sum()),
            )

    def smooth(self, normal: NormalEquations, mean: Floats, place: int) -> Floats:
        """Mean of the smooth features' weights [a] beside effects and nuisances [n + z]."""
        count = len(mean)
        inner = self.gram[count:, count:] + np.diag(normal.spread**-2.0)
        rest = self.moments[count:, place] - self.gram[count:, :count] @ mean
        return np.asarray(np.linalg.solve(inner, rest))


def marginalised(
    weighed: Weighed, groups: tuple[int, int, int], sizes: tuple[Floats, Floats]
) -> list[NormalEquations]:
    """Marginalise smooth features, the last columns, in three groups of so many.

    sizes: prior spreads of the first and of the second group, all of which are tried; the third
    group's is 1.
    """
    general, bent, absent = groups
    kept = len(weighed.gram) - sum(groups)
    end = len(weighed.gram)
    there, nats = weighed.without(slice(end - absent, end), 1.0)
    out = []
    for second in sizes[1]:
        own = slice(kept + general, kept + general + bent)
        inner, more = there.without(own, second)
        for first, (left, most) in zip(sizes[0], inner.at_sizes(kept, sizes[0]), strict=True):
            spread = np.repeat([first, second, 1.0], groups)
            constants = np.asarray(-0.5 * left.squares - nats - more - most)
            out.append(NormalEquations(spread, left.gram, left.moments, constants))
    return out


def by_delay(normal: NormalEquations, sizes: Floats) -> Floats:
    """Log evidence at each delay [S], at prior spreads [n + z]."""
    factor = np.linalg.cholesky(normal.gram + np.diag(sizes**-2.0))
    half = np.log(np.diag(factor)).sum() + np.log(sizes).sum()
    found = solve_triangular(factor, normal.moments, lower=True)
    return np.asarray(normal.constants + 0.5 * np.square(found).sum(axis=0) - half)


def solved(normal: NormalEquations, place: int, sizes: Floats, signed: Bools) -> Solution:
    """Solve at one delay; signed coefficients [n] are held at 0 where they would be negative.

    Of two that a recording hardly tells apart, free ones of opposite sign would mislead the next
    linearisation.
    """
    sizes = sizes.copy()
    moment, count = normal.moments[:, place], len(signed)
    while True:
        precision = normal.gram + np.diag(sizes**-2.0)
        covariance = np.asarray(np.linalg.inv(precision), float)
        mean = covariance @ moment
        below = np.flatnonzero(signed & (mean[:count] < 0) & (sizes[:count] > 2 * _HELD))
        if not below.size:
            break
        shown = mean[below] / np.sqrt(np.diag(covariance)[below])
        sizes[below[np.argmin(shown)]] = _HELD
    half = 0.5 * np.linalg.slogdet(precision)[1] + np.log(sizes).sum()
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
) -> Floats:
    """Draw effects and nuisances [s, n + z], signed ones from the part that is not negative.

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
    kept = np.empty((_SWEEPS, count))
    for sweep in range(-_WARMING, _SWEEPS):
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
