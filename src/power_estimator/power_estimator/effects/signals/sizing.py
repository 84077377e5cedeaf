"""Torque constants and scales of drives from their recordings."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from power_recordings.alignment.dataset import AlignedDataset
from wattwalk_core.arrays import Singles

from power_estimator.drive_types import assign, infer_types
from power_estimator.effects.signals.scale import DriveScale, scale_of

UNKNOWN_CONSTANT = 1.0  # N·m/A
_LEAST_SHOWN = 0.1  # of the power's spread, that a torque constant explains


def with_torque(data: AlignedDataset, constants: Mapping[str, float]) -> AlignedDataset:
    """Return data whose torque is current × constant (N·m/A) for the drives in `constants`."""
    if not constants:
        return data
    factors = np.array([constants.get(name, 1.0) for name in data.names], np.float32)
    return replace(data, torque=data.torque * factors)


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
    """Return the scale of the drives, from their signals; drives of a type share one."""
    alike = assign(data.names, infer_types(data.names)).values()
    at_motor = np.array([name in data.motor_torque for name in data.names], dtype=bool)
    given = (data.torque, data.velocity, data.voltage, data.power)
    torque, velocity, voltage, power = (x.astype(np.float64) for x in given)
    return scale_of(torque, velocity, voltage, power, [g for g in alike if g], at_motor)
