"""Torque constants and scales of drives from their recordings."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from power_recordings.alignment.dataset import AlignedDataset

from power_estimator.drive_types import assign, infer_types
from power_estimator.effects.signals.scale import DriveScale, scale_of

Floats = NDArray[np.float64]
_LEAST_SHOWN = 0.1  # of the power's spread, that a torque constant explains


def with_torque(data: AlignedDataset, constants: Mapping[str, float]) -> AlignedDataset:
    """Torque of the drives that have a current for it, by their constants in N·m/A."""
    if not constants:
        return data
    factors = np.array([constants.get(name, 1.0) for name in data.names], np.float32)
    return replace(data, torque=data.torque * factors)


def torque_constants(data: AlignedDataset) -> dict[str, float]:
    """
    N·m/A of drives whose torque is a current, from the power that it makes with the speed.

    Regresses P on i·w, i², |w| and 1. Drives that are alike share the mean. 1 for drives that do
    not turn enough to tell.
    """
    found: dict[str, float] = {}
    for group in assign(data.names, infer_types(data.names)).values():
        own = [d for d in group if data.names[d] in data.current_as_torque]
        values = [_torque_constant(*_known(data, drive)) for drive in own]
        known = [value for value in values if value > 0.0]
        found |= {data.names[d]: float(np.mean(known)) if known else 1.0 for d in own}
    return found


def _known(data: AlignedDataset, drive: int) -> tuple[Floats, Floats, Floats]:
    signals = (data.torque[:, drive], data.velocity[:, drive], data.power[:, drive])
    good = np.isfinite(np.sum(signals, axis=0))
    current, velocity, power = (values[good].astype(np.float64) for values in signals)
    return current, velocity, power


def _torque_constant(current: Floats, velocity: Floats, power: Floats) -> float:
    shaft = current * velocity
    columns = np.stack([shaft, current**2, np.abs(velocity), np.ones_like(shaft)], axis=1)
    constant = float(np.linalg.lstsq(columns, power, rcond=None)[0][0])
    shows = abs(constant) * shaft.std() > _LEAST_SHOWN * power.std()
    return constant if shows else 0.0


def drive_scale(data: AlignedDataset) -> DriveScale:
    """Scale of the drives; those of a type share one."""
    alike = assign(data.names, infer_types(data.names)).values()
    at_motor = np.array([name in data.motor_torque for name in data.names], dtype=bool)
    given = (data.torque, data.velocity, data.voltage, data.power)
    return scale_of(*(x.astype(np.float64) for x in given), [g for g in alike if g], at_motor)
