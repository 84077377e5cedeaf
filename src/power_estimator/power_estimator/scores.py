"""Scores of estimates of power: R² as the paper defines it, errors in watts and in joules."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from wattwalk_core.arrays import Floats, Singles


@dataclass(frozen=True)
class Score:
    """Scores of one estimate; NaN for a score that is undefined."""

    r2: float
    rmse_w: float
    bias_w: float  # mean of estimated − measured
    energy_error: float  # see energy_error()
    samples: int
    error_j: float = float('nan')  # energy estimated less that measured
    energy_j: float = float('nan')  # measured
    r2_std: float = float('nan')  # spread of R² over stretches or folds
    coverage: float = float('nan')  # share of the measured in the interval, where there is one
    interval_w: float = float('nan')  # its mean width

    def json(self) -> dict[str, float | None]:
        """Return all fields by name, to eight significant digits; None for NaN."""
        return {
            key: float(f'{value:.8g}') if np.isfinite(value) else None
            for key, value in asdict(self).items()
        }


def r2(measured: ArrayLike, estimated: ArrayLike) -> float:
    """Return R² = 1 − SS_res/SS_tot (Section II-A); NaN if the measurement is constant."""
    y, f = _pairs(measured, estimated)
    total = np.sum((y - y.mean()) ** 2) if y.size else 0.0
    return float(1 - np.sum((y - f) ** 2) / total) if total > 0 else float('nan')


def rmse(measured: ArrayLike, estimated: ArrayLike) -> float:
    """Return the root of the mean squared error, in the unit of the inputs; NaN without pairs."""
    y, f = _pairs(measured, estimated)
    return float(np.sqrt(np.mean((y - f) ** 2))) if y.size else float('nan')


def bias(measured: ArrayLike, estimated: ArrayLike) -> float:
    """Return the mean of estimated − measured, in the unit of the inputs; NaN without pairs."""
    y, f = _pairs(measured, estimated)
    return float(np.mean(f - y)) if y.size else float('nan')


def energy_error(
    measured: ArrayLike, estimated: ArrayLike, rate: float, window: float = 60.0
) -> float:
    """Return the mean |error| of the energy over windows, relative to the mean measured energy.

    rate: Hz of the samples, in W; window: s. An incomplete window counts only if there is no full
    one. NaN if no energy was measured.
    """
    y, f = _pairs(measured, estimated)
    n = min(round(window * rate), y.size)
    if not n:
        return float('nan')
    count = y.size // n
    energy = y[: count * n].reshape(count, n).sum(axis=1)
    error = f[: count * n].reshape(count, n).sum(axis=1) - energy
    drawn = np.abs(energy).mean()
    return float(np.abs(error).mean() / drawn) if drawn > 0 else float('nan')


def score(measured: ArrayLike, estimated: ArrayLike, rate: float) -> Score:
    """Return all scores of an estimate, W, sampled at rate (Hz); pairs with a NaN are left out."""
    y, f = _pairs(measured, estimated)
    joules = (float((f - y).sum() / rate), float(y.sum() / rate)) if y.size else ()
    return Score(r2(y, f), rmse(y, f), bias(y, f), energy_error(y, f, rate), int(y.size), *joules)


def coverage(found: Score, measured: ArrayLike, low: ArrayLike, high: ArrayLike) -> Score:
    """Return the score with the share of measured power in [low, high], and their mean width."""
    y, a, b = (np.asarray(values, np.float64).ravel() for values in (measured, low, high))
    known = np.isfinite(y) & np.isfinite(a)
    if not known.any():
        return found
    inside = (a[known] <= y[known]) & (y[known] <= b[known])
    return replace(
        found, coverage=float(inside.mean()), interval_w=float((b[known] - a[known]).mean())
    )


def block_means(values: Singles, runs: Iterable[slice], block: int = 4) -> Singles:
    """Return the mean of each block of rows: the paper's 200 Hz → 50 Hz (Section II-A).

    values [T, …] → [N, …]; blocks lie inside the runs (slices of rows), rows that fill no block
    are left out, and a block with a NaN is NaN.
    """
    parts = []
    for run in runs:
        rows = values[run]
        count = len(rows) // block
        parts.append(rows[: count * block].reshape(count, block, *rows.shape[1:]).mean(axis=1))
    if not parts:
        return np.empty((0, *values.shape[1:]), np.float32)
    return np.concatenate(parts).astype(np.float32, copy=False)


def _pairs(measured: ArrayLike, estimated: ArrayLike) -> tuple[Floats, Floats]:
    y = np.asarray(measured, np.float64).ravel()
    f = np.asarray(estimated, np.float64).ravel()
    if y.shape != f.shape:
        raise ValueError(f'measured has {y.size} values, estimated {f.size}')
    both = np.isfinite(y) & np.isfinite(f)
    return y[both], f[both]
