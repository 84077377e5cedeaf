"""Linear Gaussian problems with the discrepancy marginalised: evidence, means and draws."""

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
    """
    Normal equations at one size of the discrepancy, for S delays of the power.

    n effects and z nuisances are left; a smooth features are marginalised.
    """

    gram: Floats  # [n + z, n + z]
    moments: Floats  # [n + z, S]
    constants: Floats  # nats [S]
    factor: Floats  # lower Cholesky factor of the smooth features' precision [a, a]
    left: Floats  # [a, n + z]
    right: Floats  # [a, S]

    def smooth(self, mean: Floats, place: int) -> Floats:
        """Mean of the smooth features' weights [a] beside effects and nuisances [n + z]."""
        rest = self.right[:, place] - self.left @ mean
        return np.asarray(solve_triangular(self.factor, rest, lower=True, trans='T'))

    def taken(self, kept: NDArray[np.intp]) -> 'NormalEquations':
        """Return the problem of some of the columns alone."""
        return NormalEquations(
            self.gram[np.ix_(kept, kept)],
            self.moments[kept],
            self.constants,
            self.factor,
            self.left[:, kept],
            self.right,
        )


@dataclass(frozen=True)
class Solution:
    """Gaussian posterior of effects and nuisances at one delay; signed ones are not negative."""

    evidence: float  # nats
    mean: Floats  # [n + z]
    covariance: Floats  # [n + z, n + z]


def marginalised(
    gram: Floats, moments: Floats, squares: Floats, spread: Floats
) -> NormalEquations:
    """Marginalise the last a columns at prior spreads [a]; squares: of the weighted target [S]."""
    count = len(gram) - len(spread)
    factor = np.asarray(np.linalg.cholesky(gram[count:, count:] + np.diag(spread**-2.0)), float)
    left = solve_triangular(factor, gram[count:, :count], lower=True)
    right = solve_triangular(factor, moments[count:], lower=True)
    half = float(np.log(np.diag(factor)).sum() + np.log(spread).sum())
    constants = np.asarray(0.5 * np.square(right).sum(axis=0) - 0.5 * squares - half)
    return NormalEquations(
        np.asarray(gram[:count, :count] - left.T @ left),
        moments[:count] - left.T @ right,
        constants,
        factor,
        left,
        right,
    )


def by_delay(normal: NormalEquations, sizes: Floats) -> Floats:
    """Log evidence at each delay [S], at prior spreads [n + z]."""
    factor = np.linalg.cholesky(normal.gram + np.diag(sizes**-2.0))
    half = np.log(np.diag(factor)).sum() + np.log(sizes).sum()
    found = solve_triangular(factor, normal.moments, lower=True)
    return np.asarray(normal.constants + 0.5 * np.square(found).sum(axis=0) - half)


def solved(normal: NormalEquations, place: int, sizes: Floats, signed: Bools) -> Solution:
    """
    Solve at one delay; signed coefficients [n] are held at 0 where they would be negative.

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
    return Solution(log, mean, np.asarray(covariance, dtype=np.float64))


def draws(
    normal: NormalEquations,
    place: int,
    sizes: Floats,
    start: Floats,
    signed: Bools,
    random: np.random.Generator,
) -> Floats:
    """
    Draw effects and nuisances [s, n + z], signed ones from the part that is not negative.

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
