"""Confidence intervals of least squares with correlated errors: a jackknife over blocks."""

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

Floats = NDArray[np.float64]
_MOST_BLOCKS = 60
_LEAST_BLOCK = 1.0  # s
_FEWEST_BLOCKS = 5
_LEVEL = 0.95


def blocks_of(time: Floats) -> NDArray[np.intp]:
    """Return the block of each of T ascending times: 5 to 60 blocks, of 1 s or more if it can."""
    span = float(time[-1] - time[0])
    count = int(np.clip(span / _LEAST_BLOCK, _FEWEST_BLOCKS, _MOST_BLOCKS))
    owner = np.minimum(((time - time[0]) / (span / count)).astype(np.intp), count - 1)
    _, numbers = np.unique(owner, return_inverse=True)
    return np.asarray(numbers, np.intp)


def left_out(jacobian: Floats, residual: Floats, owner: NDArray[np.intp]) -> Floats:
    """
    Solve jacobian [R, P] · change = residual [R] without each block in turn: changes [B, P].

    Columns of zeros stay at 0. The spread of the changes is the sandwich estimate CR3, which
    includes any correlation of the residuals within a block.
    """
    size = np.sqrt((jacobian**2).sum(axis=0))
    used = size > 0
    normal = jacobian[:, used] / size[used]
    whole, score = normal.T @ normal, normal.T @ residual
    changes = np.zeros((int(owner.max()) + 1, jacobian.shape[1]))
    for block in range(len(changes)):
        rows = owner == block
        part = normal[rows]
        solved = np.linalg.lstsq(
            whole - part.T @ part, score - part.T @ residual[rows], rcond=None
        )[0]
        changes[block, used] = solved / size[used]
    return changes


def half_width(replicas: Floats) -> Floats:
    """Return half the 95 % interval by Student's t, from values without each block [B, P]."""
    count = len(replicas)
    variance = (count - 1) / count * ((replicas - replicas.mean(axis=0)) ** 2).sum(axis=0)
    quantile = float(student.ppf(0.5 + 0.5 * _LEVEL, count - 1))
    wide: Floats = quantile * np.sqrt(variance)
    return wide
