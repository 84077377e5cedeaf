"""Linear Gaussian problems: effects, what else may be in the power, and their evidence."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from power_estimator.effects.fit.design import Active

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Columns:
    """Linearised problem of one drive: watts per unit of prior spread at N rows."""

    actives: tuple[Active, ...]
    effects: Floats  # [N, n], scaled to the rms power
    watts: Floats  # [n], coefficient in SI for one unit of effects
    nuisance: Floats  # [N, z], prior spread 1
    smooth: Floats  # [N, a + b], prior spread DISCREPANCY (a) and BENT (b)
    general: int  # a
    constant: Floats  # W [N]
    at_one: Mapping[str, Floats]  # weight of [effects, nuisance] in a quantity


@dataclass(frozen=True)
class Noise:
    """Spread of the errors, weights of rows, and how many of them count as one."""

    variance: float  # W²
    weights: Floats  # [N]
    tempering: float


@dataclass(frozen=True)
class Normal:
    """Evidence of effects with the rest marginalised, at one size of the discrepancy."""

    gram: Floats  # [n + z, n + z]
    moment: Floats  # [n + z]
    constant: float


def solved(normal: Normal, sizes: Floats) -> tuple[float, Floats, Floats]:
    """Log evidence, mean and covariance at prior spreads [n + z]."""
    precision = normal.gram + np.diag(sizes**-2.0)
    covariance = np.linalg.inv(precision)
    mean = covariance @ normal.moment
    half = 0.5 * np.linalg.slogdet(precision)[1] + np.log(sizes).sum()
    return float(normal.constant + 0.5 * normal.moment @ mean - half), mean, covariance


def bounded(
    normal: Normal, sizes: Floats, signed: NDArray[np.bool_]
) -> tuple[float, Floats, Floats]:
    """
    As `solved`, with coefficients that may not be negative held at 0 where they would be.

    Of two that a recording hardly tells apart, free ones of opposite sign would mislead the next
    linearisation. One that is held keeps a tiny spread.
    """
    sizes = sizes.copy()
    while True:
        log, mean, covariance = solved(normal, sizes)
        below = np.flatnonzero(signed & (mean[: len(signed)] < 0) & (sizes[: len(signed)] > 1e-4))
        if not below.size:
            return log, mean, covariance
        shown = mean[below] / np.sqrt(np.diag(covariance)[below])
        sizes[below[np.argmin(shown)]] = 1e-5
