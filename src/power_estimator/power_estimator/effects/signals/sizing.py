"""Torque constants and scales of drives from their recordings."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from power_recordings.alignment.dataset import AlignedDataset
from wattwalk_core.arrays import Floats, Singles

from power_estimator.drive_types import assign, infer_types
from power_estimator.effects.signals.scale import SPEED, STANDSTILL, TORQUE, VOLTAGE, DriveScale

UNKNOWN_CONSTANT = 1.0  # N·m/A
_LEAST_SHOWN = 0.1  # of the power's spread, that a torque constant explains
_ALIKE = 3.0
_ALIKE_VOLTAGE = 1.4
_SLOW = 2 * STANDSTILL  # rad/s, top speed at which friction's sign would be 0.96
_TRAVEL = 0.05  # rad, further than a held shaft gives way
_MOST_COPPER = 0.3  # W/(N·m)², ten times that of the reference drive
_VISIBLE = 0.05  # share of the largest power
_CONSTANT_GAIN = 5.0
"""Torque constants of data sheets are off by up to a fifth, torque sensors by 4 %."""


def with_torque(data: AlignedDataset, constants: Mapping[str, float]) -> AlignedDataset:
    """Return data whose torque is current × constant (N·m/A) for the drives in `constants`."""
    if not constants:
        return data
    factors = np.array([constants.get(name, 1.0) for name in data.names], np.float32)
    return replace(data, torque=data.torque * factors)


def with_voltage(data: AlignedDataset, nominal: float | Singles) -> AlignedDataset:
    """Return data with a voltage in V, of all or by drive [D], where none was measured."""
    voltage = np.asarray(data.voltage, dtype=np.float32)
    filled = np.where(np.isfinite(voltage), voltage, np.asarray(nominal, dtype=np.float32))
    return replace(data, voltage=filled)


def torque_constants(data: AlignedDataset) -> dict[str, float]:
    """Return N·m/A of drives whose torque is a current, from the power that it makes with speed.

    Regresses P on i·w, i², |w| and 1; the power of a whole robot on those of all its drives.
    Drives that are alike share the mean. 1 for drives that do not turn enough to tell.
    """
    own = [d for d, name in enumerate(data.names) if name in data.current_as_torque]
    whole = not data.measured_drives()
    if whole:
        values = _constants(data, range(len(data.names)), data.supply)
    else:
        values = {d: _constants(data, (d,), data.power[:, d])[d] for d in own}
    found: dict[str, float] = {}
    for group in assign(data.names, infer_types(data.names)).values():
        members = [d for d in group if d in own]
        known = [values[d] for d in members if values[d] > 0.0]
        found |= {
            data.names[d]: float(np.mean(known)) if known else UNKNOWN_CONSTANT for d in members
        }
    return found


def _constants(data: AlignedDataset, drives: Sequence[int], power: Singles) -> dict[int, float]:
    """N·m/A by drive, 0 where it does not show in the power [T]."""
    current, velocity = (
        x[:, list(drives)].astype(np.float64) for x in (data.torque, data.velocity)
    )
    good = np.isfinite(power) & np.isfinite(current + velocity).all(axis=1)
    if good.sum() < 4 * len(drives) + 4:
        return dict.fromkeys(drives, 0.0)
    current, velocity, watts = current[good], velocity[good], power[good].astype(np.float64)
    shaft = current * velocity
    parts = [shaft, current**2, np.abs(velocity), np.ones((len(shaft), 1))]
    weights, *_ = np.linalg.lstsq(np.concatenate(parts, axis=1), watts, rcond=None)
    constants = weights[: shaft.shape[1]]
    shows = np.abs(constants) * shaft.std(axis=0) > _LEAST_SHOWN * watts.std() / len(drives)
    return {d: float(c) if s else 0.0 for d, c, s in zip(drives, constants, shows, strict=True)}


def drive_scale(data: AlignedDataset) -> DriveScale:
    """Return the scale of the drives, from their signals; drives of a type share the largest.

    Torque scales down only where it visibly costs more copper loss than the reference drive could
    have, or where the drive is more than three times as fast: else a recording without load says
    nothing about the size of its drive. Speed scales down for drives so slow that friction's sign
    would fade out. Where power was not measured, torque alone gives the scale.
    """
    given = (data.torque, data.velocity, data.voltage, data.power)
    signals = [values.astype(np.float64) for values in given]
    factors = np.ones((len(data.names), 5))
    rate = 0.0 if data.steady else float(data.rate)
    for group in filter(None, assign(data.names, infer_types(data.names)).values()):
        torque, velocity, voltage, power = (values[:, group] for values in signals)
        known = np.isfinite(power).all(axis=1)
        if known.any():
            factors[group, :4] = _factors(
                torque[known], velocity[known], voltage[known], power[known], rate
            )
        else:
            factors[group, :3] = _mechanical(torque, velocity, rate)
    at_motor = [name in data.motor_torque for name in data.names]
    factors[:, 4] = np.where(at_motor, _CONSTANT_GAIN, 1.0)
    return DriveScale(*factors.T)


def _factors(
    torque: Floats, velocity: Floats, voltage: Floats, power: Floats, rate: float
) -> Floats:
    load, top, size = (
        float(np.quantile(np.abs(x), 0.99, axis=0).max()) for x in (torque, velocity, power)
    )
    for_speed = _speed_factor(velocity, top, rate)
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


def _mechanical(torque: Floats, velocity: Floats, rate: float) -> Floats:
    load, top = (float(np.nanquantile(np.abs(x), 0.99, axis=0).max()) for x in (torque, velocity))
    for_speed = _speed_factor(velocity, top, rate)
    alike = TORQUE / _ALIKE < load < TORQUE * _ALIKE or load == 0.0
    for_torque = 1.0 if alike else load / TORQUE
    return np.array([for_torque, for_speed, for_torque * for_speed])


def _speed_factor(velocity: Floats, top: float, rate: float) -> float:
    """Return the factor of speed of drives [T, D] that reach a top speed, rad/s.

    A shaft that is held still has a speed, too, which is noise or swings to and fro. rate: samples
    a second; 0 of operating points, which are in no order.
    """
    way = np.cumsum(np.nan_to_num(velocity), axis=0) / rate if rate else np.zeros_like(velocity)
    slow = 0.0 < top < _SLOW and float(np.ptp(way, axis=0).max()) > _TRAVEL
    return top / SPEED if slow or top > _ALIKE * SPEED else 1.0


def _copper(torque: Floats, velocity: Floats, power: Floats) -> float:
    """Largest copper loss of the drives by plain least squares, W/(N·m)²."""
    found = []
    for tau, omega, watts in zip(torque.T, velocity.T, power.T, strict=True):
        columns = np.stack([tau * omega, tau**2, np.abs(omega), np.ones_like(tau)], axis=1)
        found.append(float(np.linalg.lstsq(columns, watts, rcond=None)[0][1]))
    return max(found)
