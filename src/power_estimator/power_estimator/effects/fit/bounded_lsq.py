"""Many small least-squares problems with bounds at once, from their normal equations."""

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.arrays import Floats

_BLOCK_SWEEPS = 10  # that change all offending variables at once
_SWEEPS = 90  # then the last offending one alone, which cannot cycle
_TOLERANCE = 1e-9


def bounded_solve(
    gram: Floats,
    moment: Floats,
    lower: Floats,
    upper: Floats,
    ridge: Floats | None = None,
    near: Floats | None = None,
) -> Floats:
    """Minimise x'·gram·x/2 − moment'·x with lower ≤ x ≤ upper for each problem of a batch.

    gram [B, m, m], moment [B, m], lower, upper and ridge [m] or [B, m] → x [B, m]. ridge is added
    to the diagonal (the weight of a prior around zero). near, [m] or [B, m], is the solution of a
    similar problem: the search for the bounds that hold begins at those that hold there. Block
    principal pivoting on scaled columns, then Murty's rule of one index at a time; what does not
    settle goes to scipy's lsq_linear.
    """
    batch, m = moment.shape
    if m == 0:
        return np.zeros((batch, 0))
    diagonal = np.einsum('bii->bi', gram)
    scale = np.sqrt(np.maximum(diagonal, 1e-300))
    dead = diagonal <= 1e-22 * np.maximum(diagonal.max(axis=1, keepdims=True), 1e-12)
    scale = np.where(dead, 1.0, scale)
    matrix = gram / (scale[:, :, None] * scale[:, None, :])
    weight = np.full((batch, m), 1e-9)
    if ridge is not None:
        weight = weight + np.broadcast_to(ridge, (batch, m)) / np.square(scale)
    weight = np.where(dead, 1.0, weight)
    index = np.arange(m)
    matrix[:, index, index] += weight
    target = np.where(dead, 0.0, moment / scale)
    low, high = lower * scale, upper * scale
    state = np.zeros((batch, m), dtype=np.int8)
    if near is not None:
        state[np.broadcast_to(near <= lower, state.shape)] = -1
        state[np.broadcast_to((near >= upper) & (near > lower), state.shape)] = 1
    solution = _pivot(matrix, target, low, high, state)
    return np.clip(solution / scale, lower, upper)


def _pivot(
    matrix: Floats, target: Floats, low: Floats, high: Floats, state: NDArray[np.int8]
) -> Floats:
    """Solve from a state [B, m] on: −1 at the lower bound, 1 at the upper, 0 free."""
    batch, m = target.shape
    solution = np.zeros((batch, m))
    open_ = np.arange(batch)
    for sweep in range(_SWEEPS):
        x, gradient = _solve_free(
            matrix[open_], target[open_], low[open_], high[open_], state[open_]
        )
        solution[open_] = x
        now = state[open_]
        tolerance = _TOLERANCE * (1.0 + np.abs(x).max(axis=1, keepdims=True))
        below = (now == 0) & (x < low[open_] - tolerance)
        above = (now == 0) & (x > high[open_] + tolerance)
        leave = ((now < 0) & (gradient < -tolerance)) | ((now > 0) & (gradient > tolerance))
        outside = (below | above).any(axis=1, keepdims=True)
        if sweep < _BLOCK_SWEEPS:
            leave &= ~outside
            worst = np.abs(gradient) * leave
            leave &= worst >= worst.max(axis=1, keepdims=True)
        else:
            offends = below | above | leave
            last = np.cumsum(offends[:, ::-1], axis=1)[:, ::-1] == 1  # none of them is behind it
            below, above, leave = below & last, above & last, leave & last
        state[open_] = np.where(below, -1, np.where(above, 1, np.where(leave, 0, now)))
        unsettled = (below | above | leave).any(axis=1)
        open_ = open_[unsettled]
        if open_.size == 0:
            return solution
    for problem in open_.tolist():
        solution[problem] = _one(matrix[problem], target[problem], low[problem], high[problem])
    return solution


def _solve_free(
    matrix: Floats, target: Floats, low: Floats, high: Floats, state: NDArray[np.int8]
) -> tuple[Floats, Floats]:
    free = state == 0
    held = np.where(state < 0, low, np.where(state > 0, high, 0.0))
    right = target - np.einsum('bij,bj->bi', matrix, held)
    right = np.where(free, right, held)
    left = np.where(free[:, :, None] & free[:, None, :], matrix, 0.0)
    index = np.arange(matrix.shape[1])
    left[:, index, index] = np.where(free, left[:, index, index], 1.0)
    x = np.linalg.solve(left, right[..., None])[..., 0]
    return x, np.einsum('bij,bj->bi', matrix, x) - target


def _one(matrix: Floats, target: Floats, low: Floats, high: Floats) -> Floats:
    from scipy.optimize import lsq_linear  # slow to import, and nodes import this file

    values, vectors = np.linalg.eigh(matrix)
    root = np.sqrt(np.maximum(values, 1e-14))
    a = root[:, None] * vectors.T
    b = (vectors.T @ target) / root
    fitted: Floats = lsq_linear(a, b, bounds=(low, np.maximum(high, low + 1e-12))).x
    return fitted
