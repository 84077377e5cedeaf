"""Structure that lives in time alone: cycles, drift and steps of no known cause."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from power_estimator.effects import Effect, Signals, Term
from wattwalk_core.arrays import Floats

from power_lab.structure.shapes import DriveProblem, hats

_SHORTEST = 3.0  # s, of a cycle: shorter ones are steps of the gait
_HARMONICS = 6
_KNOT = 25.0  # s, between knots of a drift
_FAST = 8.0  # s, between knots of a drift that is over within part of a minute
_SWITCH_KNOTS = 3  # of the drift beside something that is switched on once
_FINE = 12  # periods tried within the width of a line
_LINES = 4


@dataclass(frozen=True)
class Course:
    """A shape in time: a cycle, a drift by recording, or a drift of one recording with a step."""

    period: float = 0.0  # s, of a cycle
    knots: int = 0  # of a drift
    step: tuple[float, float] | None = None  # by the clock, s: the recording's start, and the step

    @property
    def width(self) -> int:
        """Number of regressors."""
        return 2 * _HARMONICS if self.period else self.knots + (self.step is not None)

    @property
    def words(self) -> str:
        """Name of the course, to be read after "in time alone:"."""
        if self.period:
            return f'a cycle of {self.period:.3g} s'
        if self.step is not None:
            return f'a step after {self.step[1] - self.step[0]:.0f} s'
        return 'a drift over the recording'

    def columns(self, time: Floats, recording: NDArray[np.int32]) -> Floats:
        """Regressors of the course [T, width], from time in s and number of the recording [T]."""
        if self.period:
            angle = 2 * np.pi * (time - time[0]) / self.period
            waves = [f(h * angle) for h in range(1, _HARMONICS + 1) for f in (np.sin, np.cos)]
            return np.stack(waves, axis=1)
        out = np.zeros((len(time), self.width))
        for one in np.unique(recording):
            rows = recording == one
            place = time[rows] - time[rows][0]
            place = place / max(place[-1], 1e-9) * (self.knots - 1)
            out[rows, : self.knots] = hats(place, np.arange(self.knots))
        if self.step is not None:
            out[:, -1] = time >= self.step[1]
        return out


@dataclass(frozen=True)
class InTime:
    """Course in time that explains most of one drive's residual."""

    drive: int
    shape: Course
    gain: float  # W² by row, held out
    amplitude: float  # W, largest less smallest


def course_effect(name: str, courses: Mapping[str, Course]) -> Effect:
    """Effect that follows recording time alone, by a course for each drive; never for a file."""
    count = max(course.width for course in courses.values())

    def regressors(signals: Signals, **_: float) -> Floats:
        out = np.zeros((*signals.torque.shape, count))
        for column, drive in enumerate(signals.names):
            if drive in courses:
                own = courses[drive].columns(signals.time, signals.recording)
                out[:, column, : own.shape[1]] = own
        return out

    return Effect(
        name=name,
        physics='a course in time that the state of the drives does not explain',
        formula='s(t)',
        terms=tuple(Term(f's{i}', 'W', -1e3, 1e3) for i in range(count)),
        regressors=regressors,
        kind='measurement',
        per_drive=True,
    )


def in_time(problem: DriveProblem, time: Floats, recording: NDArray[np.int32]) -> InTime | None:
    """Return the course over time, s [N], that explains most of a drive's residual, or None.

    recording: number of the recording of each row [N].
    """
    best: InTime | None = None
    for one in _courses(problem, time, recording):
        columns = one.columns(time, recording)
        if not one.period:
            columns = columns - columns.mean(axis=0)
        moments = problem.moments(columns)
        own = moments.gram[-1][-columns.shape[1] :, -columns.shape[1] :]
        unit = max(float(np.trace(own)) / columns.shape[1], 1e-9)
        solved = problem.solve(moments, 1e-3 * unit * np.eye(columns.shape[1]))
        gain = problem.base_error - float(moments.error(solved[:-1]).sum()) / moments.rows
        watts = columns @ solved[-1][-columns.shape[1] :]
        if gain > 0.0 and (best is None or gain > 1.02 * best.gain):
            low, high = np.quantile(watts, (0.01, 0.99))
            best = InTime(problem.drive, one, gain, float(high - low))
    return best


def _courses(
    problem: DriveProblem, time: Floats, recording: NDArray[np.int32]
) -> Iterator[Course]:
    seconds = float(time[-1] - time[0])
    yield Course(knots=int(np.clip(seconds / _KNOT, 3, 24)))
    yield Course(knots=3)
    yield Course(knots=int(np.clip(seconds / _FAST, 3, 3 * 24)))
    rows, means = _halves(problem)
    # Of several recordings, one that is held out would hold all that tells of a step.
    if recording[0] == recording[-1] and len(means) > 2 * _SWITCH_KNOTS:
        step = float(time[0]), float(time[rows[_step(means)]])
        yield Course(knots=_SWITCH_KNOTS, step=step)
    for period in _periods(time[rows], means):
        yield Course(period=period)


def _halves(problem: DriveProblem) -> tuple[NDArray[np.int64], Floats]:
    """First rows [n] of half seconds, and the residual's means over them, W [n]."""
    rows, mask = problem.blocks.rows, problem.blocks.mask[..., 0]
    half = mask.shape[1] // 2
    left = np.where(mask, np.nan_to_num(problem.residual[rows]), 0.0)
    sums, counts = (
        own[:, : 2 * half].reshape(len(own), 2, half).sum(axis=2) for own in (left, mask)
    )
    used = counts > 0
    return rows[:, [0, half]][used], sums[used] / counts[used]


def _step(values: Floats) -> int:
    """Index at which a step beside a line explains most of the values [n]."""
    n = len(values)
    line = np.arange(n) - (n - 1) / 2
    values = values - values.mean()
    values = values - line * (line @ values) / (line @ line)
    after = np.arange(n - 1, 0, -1)  # of a step from 1, 2 … n − 1 on
    on_line = np.cumsum(line[::-1])[::-1][1:]
    square = after - after**2 / n - on_line**2 / (line @ line)
    product = np.cumsum(values[::-1])[::-1][1:]
    inside = slice(1, -1)  # a step of one value is no step
    return 2 + int(np.argmax(product[inside] ** 2 / np.maximum(square[inside], 1e-9)))


def _periods(stamps: Floats, means: Floats) -> list[float]:
    """Periods of the strongest lines of means [n] at stamps, s."""
    if len(means) == 0:
        return []
    stamps, means = stamps - stamps[0], means - means.mean()
    span = float(stamps[-1] - stamps[0])
    if span < 4 * _SHORTEST:
        return []
    frequencies = np.arange(1.5 / span, 1.0 / _SHORTEST, 1.0 / (_FINE * span))
    power = np.abs(np.exp(-2j * np.pi * np.outer(frequencies, stamps)) @ means)
    out: list[float] = []
    left_over = power.copy()
    for _ in range(_LINES):
        peak = int(np.argmax(left_over))
        if left_over[peak] <= 0.0:
            break
        out.append(float(1.0 / frequencies[peak]))
        left_over[max(0, peak - 2 * _FINE) : peak + 2 * _FINE + 1] = 0.0
    return out
