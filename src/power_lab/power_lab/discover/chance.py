"""What a shape gains by chance: the same fit to residuals that are moved in time."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from power_estimator.effects.fit.folds import FOLDS

from power_lab.discover.problem import DriveProblem, Moments

Floats = NDArray[np.float64]


def by_chance(
    problem: DriveProblem,
    columns: Floats,
    moments: Moments,
    smoothings: Sequence[float],
    bend: Floats,
) -> Floats:
    """
    Held-out gain W² by row [S] of columns [N, K] on the moved residual.

    Both are taken with the base's columns projected out, and the best smoothing is chosen as for
    the residual itself.
    """
    rows, folds, m = problem.blocks.rows, problem.folds, len(problem.ridge)
    own, mask = problem.scatter
    left = problem.moved_residual
    joined = np.concatenate([own, columns[rows] * mask[..., None]], axis=2)
    cross = joined.transpose(0, 2, 1) @ left
    train = np.concatenate([folds.training, np.ones((1, len(cross)))])
    test = (folds.test == np.arange(FOLDS)[:, None]).astype(np.float64)
    own_moment = np.tensordot(train, cross, axes=1)
    test_moment = np.tensordot(test, cross, axes=1)
    k = columns.shape[1]
    ridge = np.diag(np.concatenate([problem.ridge, np.zeros(k)]))
    base = np.zeros((FOLDS, m + k, left.shape[2]))
    for fold in range(FOLDS):
        base[fold, :m] = _solved(moments.gram[fold, :m, :m] + ridge[:m, :m], own_moment[fold, :m])
    start = _error(moments, test_moment, base)
    best = np.full(left.shape[2], -np.inf)
    for smoothing in smoothings:
        full = np.zeros_like(base)
        for fold in range(FOLDS):
            matrix = moments.gram[fold] + ridge
            matrix[m:, m:] += smoothing * bend + 1e-6 * smoothings[-1] * np.eye(k)
            full[fold] = _solved(matrix, own_moment[fold])
        best = np.maximum(best, start - _error(moments, test_moment, full))
    return best / moments.rows


def _error(moments: Moments, moment: Floats, solved: Floats) -> Floats:
    """Sum of squared errors less that of the target, W² [S]."""
    product = moments.test_gram @ solved
    return np.asarray((solved * (product - 2.0 * moment)).sum(axis=(0, 1)))


def _solved(matrix: Floats, right: Floats) -> Floats:
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-12))
    unit = matrix / np.outer(scale, scale) + 1e-9 * np.eye(len(scale))
    return np.asarray(np.linalg.solve(unit, right / scale[:, None]) / scale[:, None])
