"""Clock and channels against a reference, fitted together, with intervals."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from power_calibration.analyser.curve import Curve
from power_calibration.analyser.jackknife import blocks_of, half_width, left_out
from power_calibration.analyser.search import Match

Floats = NDArray[np.float64]
_STEPS = 12


@dataclass(frozen=True)
class Value:
    """A figure and its interval of 95 %."""

    value: float
    low: float
    high: float

    @property
    def interval(self) -> list[float]:
        """Low and high."""
        return [self.low, self.high]


@dataclass(frozen=True)
class Clock:
    """
    From the reference's time to ours: ours = t + offset + (t − centre)·(1/(1 + drift) − 1).

    offset holds at centre (s, of the reference's clock).
    """

    offset: float
    drift: float
    centre: float

    def reference(self, ours: Floats) -> Floats:
        """The reference's time at ours, s."""
        since: Floats = ours - self.centre - self.offset
        times: Floats = self.centre + since * (1.0 + self.drift)
        return times

    def ours(self, reference: Floats) -> Floats:
        """Our time at the reference's, s."""
        times: Floats = self.centre + self.offset + (reference - self.centre) / (1.0 + self.drift)
        return times


@dataclass(frozen=True)
class Fit:
    """
    Clock and K channels; in a channel true = gain·ours + level for slow signals.

    fixed: whose level cannot be told from its gain and was held at 0. noise: standard deviation
    of what remains [K], in V or A.
    """

    clock: Clock
    offset: Value  # s
    drift: Value  # 1
    gain: tuple[Value, ...]
    level: tuple[Value, ...]  # offset of each channel
    fixed: tuple[bool, ...]
    correlation: tuple[float, ...]
    noise: Floats
    blocks: int
    seconds: float
    spread: Floats  # standard deviation of the reference [K]
    mean: Floats  # of the reference [K]
    rise: Floats  # RMS slope of the reference, per s [K]


def fit(ours: Curve, reference: Curve, match: Match, rate: float) -> Fit | None:
    """
    Refine a match and fit the channels; None where under 3 s are left of the overlap.

    Both curves hold the same K channels, low-passed to `rate` Hz. Ours, whose noise is the larger,
    is the one explained, so that noise does not flatten the slope:
    ours = slope·reference + level + bend·reference'', where the second derivative takes up what
    the limited bandwidths of the two do at the upper end of the band, which else would pass for
    a wrong gain. Gauss-Newton over offset, drift and each channel's three, each channel weighed
    by its residual.

    Intervals: leave-one-block-out jackknife over up to 60 consecutive blocks of at least 1 s (the
    sandwich CR3), with Student's t. Whatever correlation the residuals have within a block
    (gait, ripple, drift of temperature) is in it; between blocks they count as independent.
    """
    problem = _Problem.of(ours, reference, match, rate)
    if problem is None:
        return None
    fixed = [False] * problem.channels
    found = _solve(problem, match, fixed)
    for channel, level in enumerate(found.level):
        mean = float(np.mean(problem.values[:, channel]))
        wide = 0.5 * (level.high - level.low) > 0.02 * abs(mean)
        fixed[channel] = wide and abs(mean) > 3.0 * float(np.std(problem.values[:, channel]))
    return _solve(problem, match, fixed) if any(fixed) else found


@dataclass(frozen=True)
class _Problem:
    time: Floats  # ours, s [T]
    values: Floats  # ours [T, K]
    reference: Curve
    rise: Curve
    bend: Curve

    @property
    def channels(self) -> int:
        return self.values.shape[1]

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


def with_folds(found: Fit, folds: Floats) -> Fit:
    """
    The fit with intervals that allow for what our sampling folds into the band, RMS [K].

    A motion that repeats itself in step with our samples folds its fast harmonics onto the slow
    ones at a fixed phase, so that no averaging takes them out: at worst they are a gain error of
    fold/spread and a time error of fold/RMS slope. Added to the intervals as squares.
    """
    relative = folds / np.maximum(found.spread, 1e-12)
    late = 1.0 / np.sqrt(np.sum((np.maximum(found.rise, 1e-12) / np.maximum(folds, 1e-12)) ** 2))
    return replace(
        found,
        offset=_wider(found.offset, float(late)),
        gain=tuple(_wider(g, r * g.value) for g, r in zip(found.gain, relative, strict=True)),
        level=tuple(
            level if fixed else _wider(level, float(r * abs(mean)))
            for level, r, mean, fixed in zip(
                found.level, relative, found.mean, found.fixed, strict=True
            )
        ),
    )


def _wider(value: Value, by: float) -> Value:
    half = float(np.hypot(0.5 * (value.high - value.low), by))
    return Value(value.value, value.value - half, value.value + half)


def _solve(problem: _Problem, match: Match, fixed: list[bool]) -> Fit:
    channels = problem.channels
    centre = 0.5 * (problem.time[0] + problem.time[-1])
    clock = _moved(Clock(match.offset, match.drift, match.centre), centre)
    weights = np.ones(channels)
    slopes, levels, bends = np.ones(channels), np.zeros(channels), np.zeros(channels)
    for step in range(_STEPS):
        lines = np.array([slopes, levels, bends])
        jacobian, residual, shown, good = _linear(problem, clock, lines, weights, fixed)
        scale = np.maximum(np.sqrt((jacobian**2).sum(axis=0)), 1e-12)
        change = np.linalg.lstsq(jacobian / scale, residual.ravel(), rcond=None)[0] / scale
        if step < 1:  # lines first: the slopes of the signal need them
            change[:2] = 0.0
            for channel in range(channels):
                a, b = _line(shown[:, channel], problem.values[good, channel], fixed[channel])
                slopes[channel], levels[channel] = a, b
            rest = problem.values[good] - slopes * shown - levels
            weights = 1.0 / np.maximum(rest.std(axis=0), 1e-9)
            continue
        clock = _shifted(clock, float(change[0]), float(change[1]))
        slopes += change[2 : 2 + channels]
        levels += change[2 + channels : 2 + 2 * channels]
        bends += change[2 + 2 * channels :]
        rest = residual - (jacobian @ change).reshape(residual.shape)
        weights = weights / np.maximum(rest.std(axis=0), 1e-9)
        if step > 3 and abs(change[0]) < 1e-8 and abs(change[1]) < 1e-9:
            break
    lines = np.array([slopes, levels, bends])
    jacobian, residual, shown, good = _linear(problem, clock, lines, weights, fixed)
    time = problem.time[good]
    owner = blocks_of(time)
    changes = left_out(jacobian, residual.ravel(), np.repeat(owner, channels))
    a = slopes + changes[:, 2 : 2 + channels]
    b = levels + changes[:, 2 + channels : 2 + 2 * channels]
    wide = half_width(np.column_stack([changes[:, :2], 1.0 / a, -b / a]))

    def value(middle: float, place: int) -> Value:
        half = float(wide[place])
        return Value(float(middle), float(middle) - half, float(middle) + half)

    return Fit(
        clock=clock,
        offset=value(clock.offset, 0),
        drift=value(clock.drift, 1),
        gain=tuple(value(1.0 / slopes[k], 2 + k) for k in range(channels)),
        level=tuple(value(-levels[k] / slopes[k], 2 + channels + k) for k in range(channels)),
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
    problem: _Problem,
    clock: Clock,
    lines: Floats,
    weights: Floats,
    fixed: list[bool],
) -> tuple[Floats, Floats, Floats, NDArray[np.bool_]]:
    """
    Jacobian [T·K, 2 + 3 K] over offset, drift, slopes, levels and bends; the residual [T, K].

    lines: slopes, levels and bends [3, K]. Also the reference [T, K] and which of our rows it has.
    """
    slopes, levels, bends = lines
    at = clock.reference(problem.time)
    shown, rise, bend = (c.at(at) for c in (problem.reference, problem.rise, problem.bend))
    good = np.isfinite(shown).all(axis=1)
    shown, rise, bend = shown[good], rise[good], bend[good]
    count, channels = shown.shape
    since = problem.time[good] - clock.centre - clock.offset
    jacobian = np.zeros((count, channels, 2 + 3 * channels))
    for k in range(channels):
        jacobian[:, k, 0] = -weights[k] * slopes[k] * rise[:, k] * (1.0 + clock.drift)
        jacobian[:, k, 1] = weights[k] * slopes[k] * rise[:, k] * since
        jacobian[:, k, 2 + k] = weights[k] * shown[:, k]
        jacobian[:, k, 2 + channels + k] = 0.0 if fixed[k] else weights[k]
        jacobian[:, k, 2 + 2 * channels + k] = weights[k] * bend[:, k]
    residual = weights * (problem.values[good] - slopes * shown - levels - bends * bend)
    return jacobian.reshape(count * channels, -1), residual, shown, good


def _line(x: Floats, y: Floats, through_zero: bool) -> tuple[float, float]:
    if through_zero:
        return float(x @ y / (x @ x)), 0.0
    spread = x - x.mean()
    slope = float(spread @ y / max(float(spread @ spread), 1e-12))
    return slope, float(y.mean() - slope * x.mean())


def _moved(clock: Clock, ours: float) -> Clock:
    """The same clock with its centre at one of our times."""
    centre = float(clock.reference(np.array([ours]))[0])
    return replace(clock, offset=ours - centre, centre=centre)


def _shifted(clock: Clock, offset: float, drift: float) -> Clock:
    return replace(clock, offset=clock.offset + offset, drift=clock.drift + drift)
