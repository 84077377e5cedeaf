"""Whether a motion is like those of the training data, beyond the range of each signal."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.errors import InputError

from power_estimator.network.features import FEATURES

Floats = NDArray[np.float32]
SIZE = 2 * len(FEATURES)
_QUANTILE = 0.9998
_SLACK = 1.5  # on the distance's square at that quantile; a fifth more in amplitude
_FEWEST = 20 * SIZE  # blocks


@dataclass(frozen=True)
class OutOfDistributionScore:
    """
    Mahalanobis distance of an estimate's block of samples from those of the training data.

    It looks at the mean of position error, torque and speed over the block and at their change
    within it, so that it notices what is usual one by one but not together: torque that does not
    go with the error, or motion much faster than any that was seen.
    """

    mean: tuple[float, ...]  # [6]
    inverse: tuple[tuple[float, ...], ...]  # of the covariance [6, 6]
    limit: float  # of the distance's square

    def __post_init__(self) -> None:
        shape = (np.shape(self.mean), np.shape(self.inverse))
        if shape != ((SIZE,), (SIZE, SIZE)) or not np.isfinite(self.inverse).all():
            raise InputError(
                f'likeness of shapes {shape} is not {SIZE} and {SIZE} × {SIZE} numbers'
            )
        if not (np.isfinite(self.mean).all() and self.limit > 0):
            raise InputError(f'likeness has mean {self.mean} and limit {self.limit}')

    @classmethod
    def fit(cls, blocks: Floats, mirror: bool) -> 'OutOfDistributionScore | None':
        """From blocks [N, S, 3] of training data; None if they are few or always the same."""
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

    def content(self) -> dict[str, Any]:
        """As lists and numbers, for a card."""
        rows = [list(row) for row in self.inverse]
        return {'mean': list(self.mean), 'inverse': rows, 'limit': self.limit}

    @classmethod
    def of(cls, content: Mapping[str, Any]) -> 'OutOfDistributionScore':
        """From `content`; KeyError, TypeError, ValueError or InputError for anything else."""
        inverse = tuple(tuple(float(v) for v in row) for row in content['inverse'])
        return cls(tuple(float(v) for v in content['mean']), inverse, float(content['limit']))


class Guard:
    """Tells for D drives at once whether a block of samples is unlike the training data."""

    def __init__(self, known: Iterable[OutOfDistributionScore | None]) -> None:
        """known: what each drive is compared with; None says nothing about a drive."""
        drives = list(known)
        self._mean = np.zeros((len(drives), SIZE))
        self._inverse = np.zeros((len(drives), SIZE, SIZE))
        self._limit = np.full(len(drives), np.inf)
        for index, likeness in enumerate(drives):
            if likeness is not None:
                self._mean[index] = likeness.mean
                self._inverse[index] = likeness.inverse
                self._limit[index] = likeness.limit

    def unlike(self, block: Floats) -> NDArray[np.bool_]:
        """Which drives [..., D] move unlike the training data in a block [..., S, D, 3]."""
        away = describe(np.moveaxis(block, -2, -3)) - self._mean
        square = np.einsum('...di,dij,...dj->...d', away, self._inverse, away)
        return np.asarray(square > self._limit)


def describe(blocks: Floats) -> Floats:
    """Mean over and change within blocks [..., S, 3] → [..., 6]."""
    change = blocks[..., -1, :] - blocks[..., 0, :]
    return np.concatenate([blocks.mean(axis=-2), change], axis=-1)
