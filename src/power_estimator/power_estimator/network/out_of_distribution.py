"""Distance of a motion from those of the training data, beyond the range of each signal."""

from collections.abc import Iterable
from typing import Annotated

import numpy as np
from wattwalk_core.arrays import Bools, Singles
from wattwalk_core.errors import InputError
from wattwalk_core.schema import CheckedFields, Quantity, schema

from power_estimator.network.features import FEATURES

SIZE = 2 * len(FEATURES)
_QUANTILE = 0.9998
_SLACK = 1.5  # on the distance's square at that quantile; a fifth more in amplitude
_FEWEST = 20 * SIZE  # blocks
_Number = Annotated[float, Quantity(-1e18, 1e18)]


@schema
class OutOfDistributionScore(CheckedFields):
    """Mahalanobis distance of an estimate's block of samples from those of the training data.

    It is of the mean of position error, torque and speed over the block and of their change within
    it. So it grows with combinations outside the training data, such as torque that does not match
    the error, and with motion faster than in training.
    """

    mean: tuple[_Number, ...]  # [6]
    inverse: tuple[tuple[_Number, ...], ...]  # of the covariance [6, 6]
    limit: Annotated[float, Quantity(1e-30, 1e30)]  # of the distance's square

    def __post_init__(self) -> None:
        super().__post_init__()
        sizes = [len(self.mean), len(self.inverse), *(len(row) for row in self.inverse)]
        if sizes != [SIZE] * (SIZE + 2):
            raise InputError(f'mean and inverse are not {SIZE} and {SIZE} × {SIZE} numbers')

    @classmethod
    def fit(cls, blocks: Singles, mirror: bool) -> 'OutOfDistributionScore | None':
        """Fit to blocks [N, S, 3] of training data; None if they are few or always the same."""
        values = describe(blocks).astype(float)
        if len(values) < _FEWEST:
            return None
        mean = np.zeros(SIZE) if mirror else values.mean(axis=0)
        away = values - mean
        covariance = away.T @ away / len(away)
        if np.diag(covariance).min() <= 0:
            return None
        inverse = np.linalg.inv(covariance + 1e-9 * np.diag(np.diag(covariance)))
        square = np.einsum('ni,ij,nj->n', away, inverse, away)
        return cls(
            tuple(mean.tolist()),
            tuple(tuple(row) for row in inverse.tolist()),
            float(_SLACK * np.quantile(square, _QUANTILE)),
        )


class Guard:
    """Test of blocks of samples for motion outside the training data, for D drives at once."""

    def __init__(self, known: Iterable[OutOfDistributionScore | None]) -> None:
        """known: score of each drive [D], None for a drive that is never marked."""
        drives = list(known)
        self._mean = np.zeros((len(drives), SIZE))
        self._inverse = np.zeros((len(drives), SIZE, SIZE))
        self._limit = np.full(len(drives), np.inf)
        for index, score in enumerate(drives):
            if score is not None:
                self._mean[index] = score.mean
                self._inverse[index] = score.inverse
                self._limit[index] = score.limit

    def unlike(self, block: Singles) -> Bools:
        """Mark the drives [..., D] whose block [..., S, D, 3] is unlike the training data."""
        away = describe(np.moveaxis(block, -2, -3)) - self._mean
        square = np.einsum('...di,dij,...dj->...d', away, self._inverse, away)
        return np.asarray(square > self._limit)


def describe(blocks: Singles) -> Singles:
    """Return mean over blocks [..., S, 3] and change from first to last row, [..., 6]."""
    change = blocks[..., -1, :] - blocks[..., 0, :]
    return np.concatenate([blocks.mean(axis=-2), change], axis=-1)
