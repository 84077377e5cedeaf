"""Size of a drive against the reference drive that bounds and thresholds are stated for."""

from dataclasses import astuple, dataclass
from typing import Self

import numpy as np
from wattwalk_core.arrays import Floats

TORQUE, SPEED, VOLTAGE = 40.0, 8.0, 48.0
"""N·m, rad/s and V of the reference drive, a leg joint of an ANYmal."""
REFERENCE = (1.0, 1.0, 1.0, 1.0, 1.0)  # factors of the reference drive
STANDSTILL = 0.05  # speed of the reference drive in rad/s below which friction's sign fades out

_WHOLE = str.maketrans('', '', '()')
_POWERS = {'²': 2, '³': 3, '⁴': 4}


@dataclass(frozen=True)
class DriveScale:
    """Factors [D] by which drives differ from the reference drive; 1 where they are alike.

    The reference drive moves 40 N·m at 8 rad/s from 48 V. A drive counts as alike within a factor
    of three, so that all joints of a leg share one scale.
    """

    torque: Floats
    speed: Floats
    power: Floats
    voltage: Floats
    gain: Floats  # of what is not known of the shaft's coefficient: Kt, where torque is a current

    @classmethod
    def reference(cls, drives: int) -> Self:
        """Return factors of 1 for a number of drives."""
        one = np.ones(drives)
        return cls(one, one, one, one, one)

    @classmethod
    def stack(cls, drives: list[tuple[float, ...]]) -> Self:
        """Return the scale of drives whose factors are given in the order of the fields."""
        table = np.array(drives, dtype=np.float64).reshape(-1, 5)
        return cls(*table.T)

    def of(self, drive: int) -> tuple[float, ...]:
        """Return the factors of one drive, in the order of the fields."""
        return tuple(float(values[drive]) for values in astuple(self))

    def take(self, drives: list[int]) -> Self:
        """Return the scale of some drives, in that order."""
        return type(self)(*(values[drives] for values in astuple(self)))

    def whole(self) -> Self:
        """Return the scale [1] of a robot's meter, which sees the power of all these drives."""
        return type(self)(
            self.torque.min(keepdims=True),
            self.speed.max(keepdims=True),
            self.power.sum(keepdims=True),
            self.voltage.max(keepdims=True),
            self.gain.max(keepdims=True),
        )

    @property
    def standstill(self) -> Floats:
        """Speed below which friction's sign fades out, rad/s [D]."""
        return STANDSTILL * self.speed

    def factor(self, unit: str, *, of_sensor: bool = False) -> Floats:
        """Return the factor [D] of a coefficient in an SI unit such as `W/(N·m)²` or `kg·m²`.

        Torque in a numerator is a loss at the drive's speed (friction, inertia), so it grows with
        power over speed. In a denominator, or of_sensor, it is the torque that is measured. What
        is not named here (s, K, °C) is the same for all drives.
        """
        lost = self.torque if of_sensor else self.power / self.speed
        text = unit.replace('N·m', 'Nm').replace('kg·m²', 'kgm2')
        result = np.ones_like(self.torque)
        for sign, part in zip((1, -1), text.partition('/')[::2], strict=True):
            sizes = {
                'Nm': lost if sign > 0 else self.torque,
                'kgm2': lost / self.speed,
                'W': self.power,
                'V': self.voltage,
                'A': self.power / self.voltage,
                'ohm': np.square(self.voltage) / self.power,
                'rad': self.speed,
            }
            for name in part.translate(_WHOLE).split('·'):
                power = _POWERS.get(name[-1:], 1)
                size = sizes.get(name.rstrip('²³⁴'), np.ones(1))
                result = result * size ** (sign * power)
        return result
