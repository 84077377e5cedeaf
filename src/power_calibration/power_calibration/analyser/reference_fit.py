"""Joint fit of clock and channels against a reference, with confidence intervals."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student
from wattwalk_core.arrays import Bools, Floats

from power_calibration.analyser.curve import Curve, Match

_MOST_BLOCKS = 60
_LEAST_BLOCK = 1.0  # s
_FEWEST_BLOCKS = 5
_LEVEL = 0.95
_STEPS = 12


def blocks_of(time: Floats) -> NDArray[np.intp]:
    """Divide ascending times [T] into 5 to 60 blocks, of 1 s or more; return block indices [T]."""
    span = float(time[-1] - time[0])
    count = int(np.clip(span / _LEAST_BLOCK, _FEWEST_BLOCKS, _MOST_BLOCKS))
    owner = np.minimum(((time - time[0]) / (span / count)).astype(np.intp), count - 1)
    _, numbers = np.unique(owner, return_inverse=True)
    return np.asarray(numbers, np.intp)


def left_out(jacobian: Floats, residual: Floats, owner: NDArray[np.intp]) -> Floats:
    """Solve jacobian [R, P] · change = residual [R] without each block in turn: changes [B, P].

    owner: block of each row [R]. Parameters with a column of zeros stay at 0. The spread of the
    changes is the sandwich estimate CR3, which includes correlation within a block.
    """
    size = np.sqrt((jacobian**2).sum(axis=0))
    used = size > 0
    normal = jacobian[:, used] / size[used]
    whole, score = normal.T @ normal, normal.T @ residual
    changes = np.zeros((int(owner.max()) + 1, jacobian.shape[1]))
    for block in range(len(changes)):
        rows = owner == block
        part = normal[rows]
        others, rest = whole - part.T @ part, score - part.T @ residual[rows]
        changes[block, used] = np.linalg.lstsq(others, rest, rcond=None)[0] / size[used]
    return changes


def half_width(replicas: Floats) -> Floats:
    """Return half the 95 % interval [P] by Student's t, from jackknife values [B, P]."""
    count = len(replicas)
    variance = (count - 1) / count * ((replicas - replicas.mean(axis=0)) ** 2).sum(axis=0)
    quantile = float(student.ppf(0.5 + 0.5 * _LEVEL, count - 1))
    return np.asarray(quantile * np.sqrt(variance))


@dataclass(frozen=True)
class IntervalEstimate:
    """A value and its 95 % interval."""

    value: float
    low: float
    high: float

    @property
    def interval(self) -> list[float]:
        """Limits as [low, high]."""
        return [self.low, self.high]

    @classmethod
    def of(cls, value: float, half: float) -> 'IntervalEstimate':
        """Make an estimate with the interval value ± half."""
        return cls(value, value - half, value + half)

    def times(self, factor: float) -> 'IntervalEstimate':
        """Return value and interval multiplied by a positive factor."""
        return IntervalEstimate(self.value * factor, self.low * factor, self.high * factor)

    def widened(self, by: float) -> 'IntervalEstimate':
        """Return the estimate with an independent error added in quadrature to the half width."""
        return self.of(self.value, float(np.hypot(0.5 * (self.high - self.low), by)))


@dataclass(frozen=True)
class Clock:
    """Mapping from the reference's time t to ours: t + offset + (t − centre)·(1/(1 + drift) − 1).

    offset holds at centre (s, of the reference's clock).
    """

    offset: float
    drift: float
    centre: float

    def reference(self, ours: Floats) -> Floats:
        """Return the reference's times for ours, s [T]."""
        return np.asarray(self.centre + (ours - self.centre - self.offset) * (1.0 + self.drift))

    def ours(self, reference: Floats) -> Floats:
        """Return our times for the reference's, s [T]."""
        since = (reference - self.centre) / (1.0 + self.drift)
        return np.asarray(self.centre + self.offset + since)

    def centred_at(self, ours: float) -> 'Clock':
        """Return the same mapping with its centre at one of our times."""
        centre = float(self.reference(np.array([ours]))[0])
        return replace(self, offset=ours - centre, centre=centre)


@dataclass(frozen=True)
class ReferenceFit:
    """Clock and K channels, where true = gain·ours + level for slow signals.

    fixed: levels that cannot be told from their gains, held at 0. noise: standard deviation of the
    residual [K], in V or A.
    """

    clock: Clock
    offset: IntervalEstimate  # s
    drift: IntervalEstimate  # 1
    gain: tuple[IntervalEstimate, ...]
    level: tuple[IntervalEstimate, ...]  # offset of each channel
    fixed: tuple[bool, ...]
    correlation: tuple[float, ...]
    noise: Floats
    blocks: int
    seconds: float
    spread: Floats  # standard deviation of the reference [K]
    mean: Floats  # of the reference [K]
    rise: Floats  # RMS slope of the reference, per s [K]


def fit_reference(ours: Curve, reference: Curve, match: Match, rate: float) -> ReferenceFit | None:
    """Refine a match and fit the channels; None where under 3 s of the overlap remain.

    Both curves hold the same K channels, low-passed to `rate` Hz. The noisier signal, ours, is the
    dependent variable, so that noise does not flatten the slope:
    ours = slope·reference + level + bend·reference''. The second derivative accounts for the
    limited bandwidths of both instruments at the upper end of the band, which would otherwise
    appear as a wrong gain. Gauss-Newton over offset, drift and the three coefficients of each
    channel, each channel weighted by its residual.

    Intervals: leave-one-block-out jackknife over up to 60 consecutive blocks of at least 1 s (the
    sandwich CR3), with Student's t. It includes any correlation of the residuals within a block
    (gait, ripple, temperature drift) and takes blocks as independent.
    """
    problem = _Problem.of(ours, reference, match, rate)
    if problem is None:
        return None
    fixed = [False] * problem.values.shape[1]
    found = _solve(problem, match, fixed)
    for channel, level in enumerate(found.level):
        values = problem.values[:, channel]
        mean = abs(float(values.mean()))
        wide = 0.5 * (level.high - level.low) > 0.02 * mean
        fixed[channel] = wide and mean > 3.0 * float(values.std())
    return _solve(problem, match, fixed) if any(fixed) else found


@dataclass(frozen=True)
class _Problem:
    """Our low-passed samples, and the reference with its first two derivatives."""

    time: Floats  # ours, s [T]
    values: Floats  # ours [T, K]
    reference: Curve
    rise: Curve
    bend: Curve

    @classmethod
    def of(cls, ours: Curve, reference: Curve, match: Match, rate: float) -> '_Problem | None':
        clock = Clock(match.offset, match.drift, match.centre)
        edges = clock.ours(np.array(reference.span))
        first, last = max(ours.span[0], edges[0]), min(ours.span[1], edges[1])
        time = first + np.arange(max(0, int((last - first) * rate))) / rate
        values = ours.at(time)
        known = np.isfinite(values).all(axis=1)
        if known.sum() < 3.0 * rate:
            return None
        rise = reference.derivative()
        return cls(time[known], values[known], reference, rise, rise.derivative())


def with_aliases(found: ReferenceFit, aliases: Floats) -> ReferenceFit:
    """Return the fit with intervals widened for aliases, RMS [K] as of `compare.aliases`.

    A motion that repeats in step with our samples aliases its fast harmonics onto the slow ones at
    a fixed phase, which no averaging removes: at worst a gain error of alias/spread and a time
    error of alias/RMS slope. Both are added to the intervals as squares.
    """
    relative = aliases / np.maximum(found.spread, 1e-12)
    slopes = np.maximum(found.rise, 1e-12) / np.maximum(aliases, 1e-12)
    levels = zip(found.level, relative, found.mean, found.fixed, strict=True)
    return replace(
        found,
        offset=found.offset.widened(float(1.0 / np.sqrt(np.sum(slopes**2)))),
        gain=tuple(g.widened(r * g.value) for g, r in zip(found.gain, relative, strict=True)),
        level=tuple(
            level if fixed else level.widened(float(r * abs(mean)))
            for level, r, mean, fixed in levels
        ),
    )


def _solve(problem: _Problem, match: Match, fixed: list[bool]) -> ReferenceFit:
    channels = problem.values.shape[1]
    centre = 0.5 * (problem.time[0] + problem.time[-1])
    clock = Clock(match.offset, match.drift, match.centre).centred_at(centre)
    weights = np.ones(channels)
    lines = np.stack([np.ones(channels), np.zeros(channels), np.zeros(channels)])
    for step in range(_STEPS):
        jacobian, residual, shown, good = _linear(problem, clock, lines, weights, fixed)
        if step < 1:  # the Jacobian of offset and drift needs slopes
            values = problem.values[good]
            for k in range(channels):
                lines[:2, k] = _line(shown[:, k], values[:, k], fixed[k])
            rest = values - lines[0] * shown - lines[1]
            weights = 1.0 / np.maximum(rest.std(axis=0), 1e-9)
            continue
        scale = np.maximum(np.sqrt((jacobian**2).sum(axis=0)), 1e-12)
        change = np.linalg.lstsq(jacobian / scale, residual.ravel(), rcond=None)[0] / scale
        offset, drift = clock.offset + float(change[0]), clock.drift + float(change[1])
        clock = Clock(offset, drift, clock.centre)
        lines += change[2:].reshape(3, channels)
        rest = residual - (jacobian @ change).reshape(residual.shape)
        weights = weights / np.maximum(rest.std(axis=0), 1e-9)
        if step > 3 and abs(change[0]) < 1e-8 and abs(change[1]) < 1e-9:
            break
    jacobian, residual, shown, good = _linear(problem, clock, lines, weights, fixed)
    time = problem.time[good]
    owner = blocks_of(time)
    changes = left_out(jacobian, residual.ravel(), np.repeat(owner, channels))
    without = lines + changes[:, 2:].reshape(-1, 3, channels)
    gains, offsets = 1.0 / without[:, 0], -without[:, 1] / without[:, 0]
    wide = half_width(np.column_stack([changes[:, :2], gains, offsets]))
    slopes, levels, _ = lines

    def estimate(value: float, place: int) -> IntervalEstimate:
        return IntervalEstimate.of(float(value), float(wide[place]))

    return ReferenceFit(
        clock=clock,
        offset=estimate(clock.offset, 0),
        drift=estimate(clock.drift, 1),
        gain=tuple(estimate(1.0 / slopes[k], 2 + k) for k in range(channels)),
        level=tuple(estimate(-levels[k] / slopes[k], 2 + channels + k) for k in range(channels)),
        fixed=tuple(fixed),
        correlation=tuple(
            float(np.corrcoef(shown[:, k], problem.values[good, k])[0, 1]) for k in range(channels)
        ),
        noise=residual.std(axis=0) / weights,
        blocks=len(changes),
        seconds=float(len(time) * np.median(np.diff(problem.time))),
        spread=shown.std(axis=0),
        mean=shown.mean(axis=0),
        rise=np.sqrt((problem.rise.at(clock.reference(time)) ** 2).mean(axis=0)),
    )


def _linear(
    problem: _Problem, clock: Clock, lines: Floats, weights: Floats, fixed: list[bool]
) -> tuple[Floats, Floats, Floats, Bools]:
    """Linearise the model: Jacobian [T·K, 2 + 3 K] over clock and lines, and residual [T, K].

    lines: slopes, levels and bends [3, K]. Also the reference [T, K] and the mask of our rows.
    """
    slopes, levels, bends = lines
    at = clock.reference(problem.time)
    shown, rise, bend = (c.at(at) for c in (problem.reference, problem.rise, problem.bend))
    good = np.asarray(np.isfinite(shown).all(axis=1), np.bool_)
    shown, rise, bend = shown[good], rise[good], bend[good]
    count, channels = shown.shape
    since = problem.time[good] - clock.centre - clock.offset
    jacobian = np.zeros((count, channels, 2 + 3 * channels))
    jacobian[:, :, 0] = -slopes * rise * (1.0 + clock.drift)
    jacobian[:, :, 1] = slopes * rise * since[:, None]
    for k in range(channels):
        level = np.full(count, 0.0 if fixed[k] else 1.0)
        jacobian[:, k, 2 + k :: channels] = np.column_stack([shown[:, k], level, bend[:, k]])
    jacobian *= weights[:, None]
    residual = weights * (problem.values[good] - slopes * shown - levels - bends * bend)
    return jacobian.reshape(count * channels, -1), residual, shown, good


def _line(x: Floats, y: Floats, through_zero: bool) -> tuple[float, float]:
    if through_zero:
        return float(x @ y / (x @ x)), 0.0
    spread = x - x.mean()
    slope = float(spread @ y / max(float(spread @ spread), 1e-12))
    return slope, float(y.mean() - slope * x.mean())
