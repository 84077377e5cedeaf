"""Units and signs checked by physics: consistency of power, torque, speed and position."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.optimize import least_squares
from wattwalk_core.arrays import Floats

_ENOUGH = 50  # samples
_ROWS = 100_000  # of a fit of many drives
_BLOCKS = 30  # of time, whose remainders tell the error of a slope
_CERTAIN = 4  # standard errors
_ALIKE = 20  # samples in a row that count as one
_TURN = 2.001 * np.pi  # rad, of an encoder that counts no turns
_FREE = 1e-4  # of the variance of τω, that no other term has
_RATE_OVER = 0.02  # s to either side, that a torque's rate is taken over: its noise is then small
_BESIDE = 1.5  # times by which the copper loss that friction adds may change a slope that is sure
_LOSSY = 1.6  # W per W of torque × speed, from which losses grow with it
_WORN_ROWS = 20_000
_OFFSET = -0.1  # of the power (rms), of a meter: at constant speed a wrong gear asks for more
_AT_REST = 0.01  # of the largest speed, below which friction's sign fades out
_SOUND = 0.99  # of samples, by size: the rest may be wrong
_COMPUTED = 0.9999  # R² of a torque on the current that it was computed from: digits are rounded
_IMPOSSIBLE = 10.0  # times the metered power: no smoothing of a meter, no gear and no loss


@dataclass(frozen=True)
class Slope:
    """Least-squares slope of one signal on another, and their correlation."""

    slope: float
    correlation: float


def velocity_slope(time: Floats, position: Floats, velocity: Floats) -> Slope | None:
    """Return the slope of velocity [N] on the rate of position [N]; near 1 where both agree.

    time: s [N]. None where the drive does not move enough to tell.
    """
    good = np.isfinite(position) & np.isfinite(velocity)
    time, position, velocity = time[good], position[good], velocity[good]
    if len(time) < _ENOUGH:
        return None
    if np.ptp(position) <= _TURN:
        position = np.unwrap(position)
    period = float(np.median(np.diff(time)))
    span = max(1, round(0.05 / max(period, 1e-6)))
    step = time[2 * span :] - time[: -2 * span]
    whole = step < 1.5 * 2 * span * period
    rate = (position[2 * span :] - position[: -2 * span]) / np.maximum(step, 1e-9)
    kernel = np.ones(2 * span + 1)
    kernel[[0, -1]] = 0.5
    mean = np.convolve(velocity, kernel / kernel.sum(), 'valid')
    return _slope(rate[whole], mean[whole])


def rate_of(time: Floats, torque: Floats) -> Floats:
    """Return the rate of a torque [N] or [N, D], in N·m/s; time: s [N]."""
    span = max(1, round(_RATE_OVER / max(float(np.median(np.diff(time))), 1e-6)))
    rows = np.arange(len(time))
    first, last = np.maximum(rows - span, 0), np.minimum(rows + span, len(time) - 1)
    step = np.maximum(time[last] - time[first], 1e-9)
    return ((torque[last] - torque[first]).T / step).T


@dataclass(frozen=True)
class ShaftBalance:
    """Slope a of P = a·τω + b·τ² + c·|ω| + d, W per W, its standard error, and R² of the fit.

    a is near 1 where units and signs are right. share: of the variance of P, what only τω
    explains. shaft, power: root mean squares of τω and P, W. rubbed: a beside e·τ·sign(ω), the
    copper loss that friction adds: in slow motion it looks like τω. delayed: a beside e·τ·dτ/dt,
    what a delay between torque and power adds, or a series spring; sprung: the same, NaN if no
    spring is sure to add it. made: mean of τω, W. losses: mean of P − a·τω, W, which is above 0
    unless the sign of P is wrong. worn: what the physics of a gear with much friction leaves of
    P, whose slope is 1, over what it leaves at any slope (`_worn`); infinite where a is not large,
    or of several drives.
    """

    slope: float
    error: float
    share: float
    r2: float
    shaft: float
    power: float
    rubbed: float
    delayed: float
    sprung: float
    made: float
    losses: float
    worn: float

    def __str__(self) -> str:
        return (
            f'{self.slope:.3g} ± {2 * self.error:.2g} W per W of torque × speed, which stands for '
            f'{self.share:.0%} of the variance'
        )

    @property
    def impossible(self) -> bool:
        """True if shaft power exceeds metered power by more than any loss or meter explains."""
        return self.shaft > _IMPOSSIBLE * self.power

    @property
    def drawn(self) -> float:
        """Mean of P, W."""
        return self.losses + self.slope * self.made


def power_balance(
    power: Floats, torque: Floats, velocity: Floats, rate: Floats | None = None
) -> ShaftBalance | None:
    """Fit the balance of a drive's power [N, W], or of a robot's with D drives.

    torque: N·m, velocity: rad/s, and the torque's rate are [N] or [N, D]; without the rate no
    spring is found. None for fewer than 500 samples.
    """
    rate = np.zeros_like(torque) if rate is None else np.nan_to_num(rate)
    power, torque, velocity, rate = _known(power, torque, velocity, rate)
    if len(power) < 10 * _ENOUGH:
        return None
    spread = max(float(np.var(power)), 1e-12)
    terms = (torque * velocity, torque**2, np.abs(velocity))
    design = np.stack([*(term.sum(axis=1) for term in terms), np.ones_like(power)], axis=1)
    shaft = design[:, 0]
    (slope, *others), inverse, rest = solve(design, power)
    heat = (torque * np.sign(velocity)).sum(axis=1, keepdims=True)
    apart, *_ = solve(np.hstack([design, heat]), power)
    spring = (torque * rate).sum(axis=1, keepdims=True)
    beside, error, _ = _fitted(np.hstack([design, spring]), power)
    sprung = min(beside[[0, -1]] - _CERTAIN * error[[0, -1]]) > 0
    free = float(1 / inverse[0, 0] / len(power))
    if free < _FREE * np.var(shaft):
        free = 0.0  # τω goes with the other terms
    least = 1e-12 * max(float(np.max(shaft**2)), 1e-24)
    return ShaftBalance(
        float(slope),
        float(np.sqrt(np.var(rest) / max(free, least) / len(power) * _ALIKE)),
        float(slope) ** 2 * free / spread,
        1 - float(np.var(rest)) / spread,
        float(np.sqrt(np.mean(shaft**2))),
        float(np.sqrt(np.mean(power**2))),
        float(apart[0]),
        float(beside[0]),
        float(beside[0]) if sprung else np.nan,
        float(np.mean(shaft)),
        float(np.mean(power - slope * shaft)),
        _worn(power, torque, velocity, others, float(np.var(rest)))
        if slope > _LOSSY and torque.shape[1] == 1
        else np.inf,
    )


def _worn(
    power: Floats, torque: Floats, velocity: Floats, linear: Sequence[float], rest: float
) -> float:
    """Return the variance that P = a·τω + f·ω + k·(τ + f)² + d leaves at a = 1 over the least.

    f = (c + e·|τ|)·sign(ω) + b·ω is the friction of a gear. The winding's current carries it, so
    that 2·k·b adds to the slope of τω. linear: factors of τ², |ω| and 1 in P = a·τω + …, which
    leaves the variance rest, W².
    """
    thin = slice(None, None, -(-len(power) // _WORN_ROWS))
    power, torque, velocity = power[thin], torque[thin, 0], velocity[thin, 0]
    way = np.tanh(velocity / (_AT_REST * max(float(np.abs(velocity).max()), 1e-12)))
    load, speed, watts = (
        max(float(np.sqrt(np.mean(x**2))), 1e-12) for x in (torque, velocity, power)
    )
    copper = max(linear[0], 1e-3 * watts / load**2)
    scale = np.array([copper, load, load / speed, watts, 1.0, 1.0])
    begin = np.array([1.0, 0.5, watts / (load * speed), max(linear[2] / watts, _OFFSET), 0.1, 1.0])

    def left(factors: Floats) -> Floats:
        k, c, b, d, e, slope = factors * scale
        friction = (c + e * np.abs(torque)) * way + b * velocity
        motor = torque + friction
        return power - slope * torque * velocity - friction * velocity - k * motor**2 - d

    least = np.array([0.0, 0.0, 0.0, _OFFSET, 0.0, 0.0])
    most = np.array([np.inf, np.inf, np.inf, np.inf, 1.0, np.inf])
    one = least_squares(
        lambda factors: left(np.append(factors, 1.0)), begin[:-1], bounds=(least[:-1], most[:-1])
    )
    free = least_squares(left, np.append(one.x, 1.0), bounds=(least, most))
    return float(np.var(one.fun) / max(min(float(np.var(free.fun)), rest), 1e-12))


@dataclass(frozen=True)
class DriveSlopes:
    """Slopes a of P = Σ(a·τω + b·τ² + c·|ω|) + d for D drives on one meter; NaN if unsure.

    figures: those that the copper loss of friction hardly changes, too, and their shares of the
    variance of P. losses: as of `ShaftBalance`.
    """

    slopes: tuple[float, ...]
    figures: tuple[float, ...]
    shares: tuple[float, ...]
    losses: float


def drive_slopes(power: Floats, torque: Floats, velocity: Floats) -> DriveSlopes | None:
    """Fit the balance of a robot's power [N, W] with terms of each drive; else `power_balance`."""
    thin = slice(None, None, -(-len(power) // _ROWS) or 1)
    power, torque, velocity = _known(power[thin], torque[thin], velocity[thin])
    if len(power) < 10 * _ENOUGH:
        return None
    shaft, constant = torque * velocity, np.ones((len(power), 1))
    design = np.hstack([shaft, torque**2, np.abs(velocity), constant])
    slopes, error, inverse = _fitted(design, power)
    beside, other, _ = _fitted(np.hstack([design, torque * np.sign(velocity)]), power)
    free = 1 / np.diag(inverse) / len(power)
    shares = slopes**2 * free / max(float(np.var(power)), 1e-12)
    sure = (np.abs(slopes) > _CERTAIN * error) & (free > _FREE * np.var(design, axis=0))
    ratio = slopes / beside[: len(slopes)]
    same = (np.abs(beside) > _CERTAIN * other)[: len(slopes)]
    same &= (ratio > 1 / _BESIDE) & (ratio < _BESIDE)
    drives = slice(torque.shape[1])
    losses = float(np.mean(power - shaft @ slopes[drives]))
    told = ((slopes, sure), (slopes, sure & same), (shares, sure & same))
    own, *shown = (tuple(np.where(known, each, np.nan)[drives].tolist()) for each, known in told)
    return DriveSlopes(own, shown[0], shown[1], losses)


def solve(terms: Floats, power: Floats) -> tuple[Floats, Floats, Floats]:
    """Fit power [N] by terms [N, K]: factors, inverse of the terms' products, and the rest [N]."""
    scale = np.maximum(np.abs(terms).max(axis=0), 1e-12)
    terms = terms / scale
    inverse = np.linalg.inv(terms.T @ terms + 1e-10 * len(power) * np.eye(len(scale)))
    found = inverse @ (terms.T @ power)
    return found / scale, inverse / np.outer(scale, scale), power - terms @ found


def _fitted(terms: Floats, power: Floats) -> tuple[Floats, Floats, Floats]:
    """Fit power [N] by terms [N, K]: factors, their standard errors, and inverse of `solve`."""
    found, inverse, rest = solve(terms, power)
    edges = np.linspace(0, len(power), _BLOCKS, endpoint=False, dtype=int)
    pulls = np.add.reduceat(terms * rest[:, None], edges) @ inverse
    error = np.sqrt((pulls**2).sum(axis=0) + _ALIKE * np.var(rest) * np.diag(inverse))
    return found, error, inverse


def factor_of(torque: Floats, current: Floats) -> float | None:
    """Return N·m for each A where a torque [N] is a current [N] times it, None where it is not.

    None for too few samples, or for signals of a few levels, which any two have in common.
    """
    good = np.isfinite(torque) & np.isfinite(current)
    x, y = current[good], torque[good]
    if len(x) < 10 * _ENOUGH or len(np.unique(x)) < _ENOUGH or len(np.unique(y)) < _ENOUGH:
        return None
    inside = np.abs(y) <= np.quantile(np.abs(y), _SOUND)  # one wrong sample decides nothing
    x, y = x[inside], y[inside]
    if not np.std(x) > 0 or not np.std(y) > 0:
        return None
    factor, _ = np.polyfit(x, y, 1)
    return float(factor) if np.corrcoef(x, y)[0, 1] ** 2 > _COMPUTED else None


def explained(power: Floats, torque: Floats, velocity: Floats) -> float | None:
    """Return the R² of P = a·τω + b·τ² + d, fitted to power [N], torque [N] and velocity [N].

    None for too few samples, or a power that does not vary.
    """
    power, torque, velocity = _known(power, torque, velocity)
    if len(power) < 10 * _ENOUGH or not np.var(power) > 0:
        return None
    *_, rest = solve(np.hstack([torque * velocity, torque**2, np.ones_like(torque)]), power)
    return 1 - float(np.var(rest)) / float(np.var(power))


def coverage(torque: Floats, velocity: Floats, cells: int = 8) -> tuple[float, float]:
    """Return shares of visited cells (cells × cells) and of visited quadrants in torque–speed.

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
    moving = np.abs(velocity) > 0.02 * np.percentile(np.abs(velocity), 99)
    quadrants = product((torque < 0, torque > 0), (velocity < 0, velocity > 0))
    visited = sum(float(np.mean(one & other & moving)) > 0.02 for one, other in quadrants)
    return float((counts > 0).mean()), visited / 4


def _known(power: Floats, *motion: Floats) -> list[Floats]:
    """Return the rows without NaN; of all but the power [N], as [N, D]."""
    columns = [np.atleast_2d(each.T).T for each in motion]
    good = np.isfinite(power) & np.isfinite(sum(columns)).all(axis=1)
    return [power[good], *(each[good] for each in columns)]


def _slope(x: Floats, y: Floats) -> Slope | None:
    if len(x) < _ENOUGH or np.std(x) == 0 or np.std(y) == 0:
        return None
    correlation = float(np.corrcoef(x, y)[0, 1])
    # Geometric mean of both regressions: noise in x alone would make the slope too small. They are
    # of absolute errors: a robot that is put back on its feet moves its joints without a velocity.
    there, back = _least_absolute(x, y), _least_absolute(y, x)
    size = np.sqrt(abs(there / back)) if back else abs(there)
    return Slope(float(size) * float(np.sign(correlation)), correlation)


def _least_absolute(x: Floats, y: Floats) -> float:
    """Return a of y = a·x by the least sum of absolute errors: a weighted median of y/x."""
    moving = x != 0
    ratio, weight = y[moving] / x[moving], np.abs(x[moving])
    order = np.argsort(ratio)
    reached = np.cumsum(weight[order])
    return float(ratio[order][np.searchsorted(reached, 0.5 * reached[-1])])
