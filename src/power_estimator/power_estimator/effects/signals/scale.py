"""Size of a drive against the reference drive that bounds and thresholds are stated for."""

from collections.abc import Sequence
from dataclasses import astuple, dataclass
from typing import Self

import numpy as np
from wattwalk_core.arrays import Bools, Floats

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


def scale_of(
    torque: Floats,
    velocity: Floats,
    voltage: Floats,
    power: Floats,
    groups: Sequence[Sequence[int]],
    at_motor: Bools,
) -> DriveScale:
    """Return the scale of D drives from torque, velocity, voltage and power [T, D] in SI units.

    power: NaN where unknown. groups: columns of drives that are built alike and share the largest
    figures. Torque scales down only where it visibly costs more copper loss than the reference
    drive could have, or where the drive is more than three times as fast: else a recording without
    load says nothing about the size of its drive. Where power was not measured, torque alone gives
    the scale. at_motor [D]: torque is a current times a constant.
    """
    factors = np.ones((torque.shape[1], 5))
    for group in map(list, groups):
        known = np.isfinite(power[:, group]).all(axis=1)
        if known.any():
            given = (x[known][:, group] for x in (torque, velocity, voltage, power))
            factors[group, :4] = _factors(*given)
        else:
            factors[group, :3] = _mechanical(torque[:, group], velocity[:, group])
    factors[:, 4] = np.where(at_motor, _UNKNOWN_CONSTANT, 1.0)
    return DriveScale(*factors.T)


_ALIKE = 3.0
_ALIKE_VOLTAGE = 1.4
_MOST_COPPER = 0.3  # W/(N·m)², ten times that of the reference drive
_VISIBLE = 0.05  # share of the largest power
_UNKNOWN_CONSTANT = 5.0
"""Torque constants of data sheets are off by up to a fifth, torque sensors by 4 %."""


def _factors(torque: Floats, velocity: Floats, voltage: Floats, power: Floats) -> Floats:
    load, top, size = (
        float(np.quantile(np.abs(x), 0.99, axis=0).max()) for x in (torque, velocity, power)
    )
    for_speed = top / SPEED if top > _ALIKE * SPEED else 1.0
    for_torque = load / TORQUE if load > _ALIKE * TORQUE else 1.0
    if 0.0 < load < TORQUE:
        least = max(_MOST_COPPER, _VISIBLE * size / load**2)
        if for_speed > 1.0 or _copper(torque, velocity, power) > least:
            for_torque = load / TORQUE
    for_power = for_torque * for_speed
    if size > _ALIKE * for_power * TORQUE * SPEED:
        for_power = size / (TORQUE * SPEED)
    ratio = float(np.median(voltage)) / VOLTAGE
    alike = 1.0 / _ALIKE_VOLTAGE < ratio < _ALIKE_VOLTAGE or not ratio > 0.0
    return np.array([for_torque, for_speed, for_power, 1.0 if alike else ratio])


def _mechanical(torque: Floats, velocity: Floats) -> Floats:
    load, top = (float(np.nanquantile(np.abs(x), 0.99, axis=0).max()) for x in (torque, velocity))
    for_speed = top / SPEED if top > _ALIKE * SPEED else 1.0
    alike = TORQUE / _ALIKE < load < TORQUE * _ALIKE or load == 0.0
    for_torque = 1.0 if alike else load / TORQUE
    return np.array([for_torque, for_speed, for_torque * for_speed])


def _copper(torque: Floats, velocity: Floats, power: Floats) -> float:
    """Largest copper loss of the drives by plain least squares, W/(N·m)²."""
    found = []
    for tau, omega, watts in zip(torque.T, velocity.T, power.T, strict=True):
        columns = np.stack([tau * omega, tau**2, np.abs(omega), np.ones_like(tau)], axis=1)
        found.append(float(np.linalg.lstsq(columns, watts, rcond=None)[0][1]))
    return max(found)
