"""Units and signs checked by physics: consistency of power, torque, speed and position."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_ENOUGH = 50  # samples


@dataclass(frozen=True)
class Slope:
    """Least-squares slope of one signal on another, and their correlation."""

    slope: float
    correlation: float


def velocity_slope(time: Floats, position: Floats, velocity: Floats) -> Slope | None:
    """
    Return the slope of the velocity on the rate of the position [N]; 1 where both agree.

    None where the drive does not move enough to tell. The rate is taken over windows in which the
    change of position is well above its noise.
    """
    good = np.isfinite(position) & np.isfinite(velocity)
    time, position, velocity = time[good], position[good], velocity[good]
    if len(time) < _ENOUGH:
        return None
    period = float(np.median(np.diff(time)))
    span = max(1, round(0.05 / max(period, 1e-6)))
    step = time[2 * span :] - time[: -2 * span]
    whole = step < 1.5 * 2 * span * period
    rate = (position[2 * span :] - position[: -2 * span]) / np.maximum(step, 1e-9)
    kernel = np.ones(2 * span + 1)
    kernel[[0, -1]] = 0.5
    mean = np.convolve(velocity, kernel / kernel.sum(), 'valid')
    return _slope(rate[whole], mean[whole])


def power_slope(
    power: Floats, torque: Floats, velocity: Floats
) -> tuple[float, float, float] | None:
    """
    Return the slope a of P = a·τω + b·τ² + c·|ω| + d, its standard error, and R².

    Near 1 where the signals are in SI units and of one sign. None where the power does not tell:
    too few samples, or mechanical power that explains less than a third of it.
    """
    good = np.isfinite(power) & np.isfinite(torque) & np.isfinite(velocity)
    power, torque, velocity = power[good], torque[good], velocity[good]
    if len(power) < 10 * _ENOUGH:
        return None
    design = np.stack(
        [torque * velocity, torque**2, np.abs(velocity), np.ones_like(power)], axis=1
    )
    scale = np.maximum(np.abs(design).max(axis=0), 1e-12)
    found, *_ = np.linalg.lstsq(design / scale, power, rcond=1e-10)
    residual = power - design / scale @ found
    spread = float(np.var(power))
    if spread <= 0:
        return None
    r2 = 1 - float(np.var(residual)) / spread
    shaft = design[:, 0] / scale[0]
    others = np.delete(design / scale, 0, axis=1)
    own, *_ = np.linalg.lstsq(others, shaft, rcond=1e-10)
    own_part = shaft - others @ own
    free = float(np.var(own_part))
    if free < 1e-4 * float(np.var(shaft)) or float(np.var(found[0] * own_part)) < 0.3 * spread:
        return None
    error = float(np.sqrt(np.var(residual) / max(free, 1e-12) / len(power) * 20)) / scale[0]
    return float(found[0] / scale[0]), error, r2


def explained(power: Floats, torque: Floats, velocity: Floats) -> float | None:
    """
    Return the R² of P = a·τω + b·τ² + d: the power that the torque draws.

    None for too few samples, or a power that does not vary.
    """
    good = np.isfinite(power) & np.isfinite(torque) & np.isfinite(velocity)
    power, torque, velocity = power[good], torque[good], velocity[good]
    if len(power) < 10 * _ENOUGH or not np.var(power) > 0:
        return None
    design = np.stack([torque * velocity, torque**2, np.ones_like(power)], axis=1)
    scale = np.maximum(np.abs(design).max(axis=0), 1e-12)
    found, *_ = np.linalg.lstsq(design / scale, power, rcond=1e-10)
    return 1 - float(np.var(power - design / scale @ found)) / float(np.var(power))


def coverage(torque: Floats, velocity: Floats, cells: int = 8) -> tuple[float, float]:
    """
    Return how much of torque–speed space was visited: share of cells, share of quadrants.

    The space is the box from the 1st to the 99th percentile of each; a quadrant counts from 2 % of
    the samples on.
    """
    good = np.isfinite(torque) & np.isfinite(velocity)
    torque, velocity = torque[good], velocity[good]
    if len(torque) < _ENOUGH:
        return 0.0, 0.0
    box = [np.percentile(torque, [1, 99]), np.percentile(velocity, [1, 99])]
    if any(high <= low for low, high in box):
        return 0.0, 0.0
    counts, *_ = np.histogram2d(torque, velocity, cells, [tuple(b) for b in box])
    still = 0.02 * np.percentile(np.abs(velocity), 99)
    quadrants = [
        float(
            np.mean((np.sign(torque) == a) & (np.sign(velocity) == b) & (np.abs(velocity) > still))
        )
        for a in (-1, 1)
        for b in (-1, 1)
    ]
    return float((counts > 0).mean()), sum(q > 0.02 for q in quadrants) / 4


def _slope(x: Floats, y: Floats) -> Slope | None:
    if len(x) < _ENOUGH or np.std(x) == 0 or np.std(y) == 0:
        return None
    correlation = float(np.corrcoef(x, y)[0, 1])
    # Geometric mean of both regressions: noise in x alone would make the slope too small.
    return Slope(float(np.std(y) / np.std(x)) * float(np.sign(correlation)), correlation)
