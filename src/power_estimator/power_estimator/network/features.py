"""Inputs of power models: position error, torque and speed of each drive (Section II-A)."""

from dataclasses import dataclass

import numpy as np
from power_recordings.alignment.dataset import AlignedDataset
from wattwalk_core.arrays import Singles
from wattwalk_core.errors import InputError

FEATURES = ('position_error', 'torque', 'velocity')


def features(data: AlignedDataset) -> Singles:
    """Return features [T, D, 3] in the order and units of FEATURES; NaN where one is missing."""
    return np.stack([data.position_error, data.torque, data.velocity], axis=2)


@dataclass(frozen=True)
class Scaling:
    """Mean and scale of features [3] and power in W; the network sees (x − mean) / scale."""

    mean: tuple[float, float, float]
    scale: tuple[float, float, float]
    power_mean: float  # W
    power_scale: float  # W

    def __post_init__(self) -> None:
        numbers = (*self.mean, *self.scale, self.power_mean, self.power_scale)
        if len(numbers) != 2 * len(FEATURES) + 2 or not np.isfinite(numbers).all():
            raise InputError(f'scaling {numbers} is not eight finite numbers')
        if min(*self.scale, self.power_scale) <= 0:
            raise InputError(f'scaling {numbers} has a scale that is not positive')

    @classmethod
    def of(cls, values: Singles, power: Singles, mirror: bool = False) -> 'Scaling':
        """Return the scaling of features [N, 3] and power [N], no NaN; InputError for constants.

        With `mirror` the mean is 0, so that a motion and its mirror image differ in sign alone.
        """
        mean, scale = values.mean(axis=0, dtype=float), values.std(axis=0, dtype=float)
        constant = [name for name, s in zip(FEATURES, scale, strict=True) if s < 1e-6]
        if constant or power.std() < 1e-6:
            raise InputError(f'{(*constant, "power")[0]} is constant: nothing to learn from')
        if mirror:
            mean, scale = np.zeros(3), np.hypot(mean, scale)
        a, b, c = (float(np.float32(x)) for x in mean)
        d, e, f = (float(np.float32(x)) for x in scale)
        return cls((a, b, c), (d, e, f), float(power.mean(dtype=float)), float(power.std()))
