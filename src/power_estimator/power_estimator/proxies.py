"""Proxies of power that rewards commonly penalise (Fig. 4), scaled to the measured mean."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from power_recordings.alignment.dataset import AlignedDataset
from wattwalk_core.arrays import Singles
from wattwalk_core.errors import InputError

from power_estimator.drive_types import DriveType, assign, infer_types
from power_estimator.model import Needs


def acceleration(data: AlignedDataset) -> Singles:
    """Return joint acceleration in rad/s² [T, D]: central differences of speed in each segment."""
    result = np.full_like(data.velocity, np.nan)
    for run in data.segments():
        if run.stop - run.start > 1:
            result[run] = np.gradient(data.velocity[run], 1 / data.rate, axis=0)
    return result


RATE: Final = 200.0  # Hz, as networks that proxies are compared with
PROXIES: Mapping[str, Callable[[AlignedDataset], Singles]] = {
    'torque_squared': lambda data: data.torque**2,
    'torque_abs': lambda data: np.abs(data.torque),
    'mechanical_power': lambda data: np.abs(data.torque * data.velocity),
    'mechanical_power_positive': lambda data: np.maximum(data.torque * data.velocity, 0),
    'acceleration_squared': lambda data: acceleration(data) ** 2,
}

WATTS: Final = ('mechanical_power', 'mechanical_power_positive')
"""Proxies that are in watts without a factor."""


@dataclass(frozen=True)
class Proxy:
    """Signal times one factor per drive type, so that its mean is that of the measured power.

    The factor comes from `fit`; a proxy without one takes it from the power measured in the data
    of the prediction, as Section II-A of the paper does. InputError for a name not in PROXIES.
    """

    name: str
    types: tuple[DriveType, ...] = ()
    factors: Mapping[str, float] = field(default_factory=dict)  # W per unit, by drive type

    def __post_init__(self) -> None:
        if self.name not in PROXIES:
            raise InputError(f'proxy {self.name!r} is not one of {", ".join(PROXIES)}')

    @property
    def needs(self) -> Needs:
        """Torque and speed, and measured power where the proxy has no factor."""
        inputs = dict.fromkeys(('torque', 'velocity'), '')
        if not self.factors and self.name not in WATTS:
            inputs['power'] = 'its factor to watts'
        return Needs(inputs, RATE, smooth=True, memory=2 / RATE)

    def fit(self, data: AlignedDataset, types: tuple[DriveType, ...] = ()) -> 'Proxy':
        """Return the proxy with a factor per drive type that makes its mean the measured mean.

        types: inferred from the drives' names if empty. A type without measured power gets no
        factor.
        """
        types = types or infer_types(data.names)
        signal = PROXIES[self.name](data)
        factors = {}
        for name, columns in assign(data.names, types).items():
            both = np.isfinite(signal[:, columns]) & np.isfinite(data.power[:, columns])
            mean = signal[:, columns][both].mean(dtype=float) if both.any() else 0.0
            if mean > 0:
                factors[name] = float(data.power[:, columns][both].mean(dtype=float) / mean)
        return replace(self, types=types, factors=factors)

    def predict(self, data: AlignedDataset) -> Singles:
        """Return the scaled signal in W [T, D]; NaN for drives without a factor.

        Without measured power a proxy in watts is not scaled; InputError for any other.
        """
        proxy = self if self.factors else self.fit(data)
        signal = PROXIES[self.name](data)
        if not proxy.factors and self.name in WATTS:
            return signal
        if not proxy.factors:
            raise InputError(
                f'{self.name} has no unit of power: it needs measured power to be scaled to, and '
                f'{", ".join(data.recordings) or "the input"} has none'
            )
        result = np.full(data.torque.shape, np.nan, np.float32)
        for name, columns in assign(data.names, proxy.types).items():
            if name in proxy.factors:
                result[:, columns] = signal[:, columns] * proxy.factors[name]
        return result
