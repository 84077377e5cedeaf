"""Errors that no effect explains: how large they are, and by how much each row counts."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.arrays import Floats

_ROUNDS: Final = 3  # of a fit and the weights by its errors
DEGREES: Final = 4.0  # of freedom of Student's t, by which blocks count


@dataclass(frozen=True)
class RowErrors:
    """Errors of a fit of all effects, with weights of its rows."""

    variance: float  # W², of a row of full weight
    left: Floats  # W [K]
    weights: Floats  # [K], 1 at most
    tempering: float  # variance of the effects' scores over blocks, over that of single rows

    def lasting(self, rows: NDArray[np.intp], overlap: float) -> float:
        """W² of the errors that last from a row to the next; rows: places [K] of these.

        overlap: correlation of white noise in the two.
        """
        pairs = np.flatnonzero(np.diff(rows) == 1)
        if not len(pairs):
            return self.variance
        products = self.weights[pairs] * self.left[pairs] * self.left[pairs + 1]
        return float(products.mean() - overlap * self.variance) / max(1.0 - overlap, 1e-3)


def learned_errors(
    columns: Floats,
    spread: Floats,
    power: Floats,
    effects: int,
    blocks: list[NDArray[np.intp]],
    least: float,
) -> RowErrors:
    """Fit power [K] by columns [K, k] with prior spreads [k], rows weighted by their errors.

    effects: number of columns, the first, whose scores tell the tempering. blocks: rows that may
    err alike. least: W², of the variance.
    """
    share, variance = np.ones(len(blocks)), 1e-3 * float(power @ power) / len(power)
    prior = np.diag(spread**-2)
    for _ in range(_ROUNDS):
        weights = np.repeat(share, [len(block) for block in blocks])
        weighed = columns * np.sqrt(weights)[:, None]
        gram, moment = weighed.T @ weighed, columns.T @ (weights * power)
        for _ in range(_ROUNDS):
            x = np.linalg.solve(gram / variance + prior, moment / variance)
            left = power - columns @ x
            variance = max(float(weights @ left**2 / len(power)), least)
        errors = np.array([np.mean(left[b] ** 2) for b in blocks])
        share = (DEGREES + 1.0) / (DEGREES + errors / np.median(errors))
        share /= share.max()
    scores = np.stack([(weights[b] * left[b]) @ columns[b] for b in blocks]) / variance
    inverse = np.linalg.inv(gram / variance + prior)
    meat = np.einsum('ij,ji->i', inverse, scores.T @ scores)[:effects].sum()
    bread = np.einsum('ij,ji->i', inverse, gram / variance)[:effects].sum()
    return RowErrors(variance, left, weights, float(meat / max(bread, 1e-12)))
