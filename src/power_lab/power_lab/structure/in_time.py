"""Structure that lives in time alone: cycles, drift and steps of no known cause."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from power_estimator.effects import Effect, Signals, Term
from wattwalk_core.arrays import Floats

from power_lab.structure.problem import DriveProblem

_SHORTEST = 3.0  # s, of a cycle: shorter ones are steps of the gait
_HARMONICS = 6
_KNOT = 25.0  # s, between knots of a drift
_SWITCH = 8.0  # s, between knots of a drift that stands for something switched on once
_FINE = 12  # periods tried within the width of a line
_LINES = 4


@dataclass(frozen=True)
class InTime:
    """A course in time of one drive's residual."""

    drive: int
    period: float  # s, 0 for a drift
    knots: int  # of a drift
    gain: float  # W² by row, held out
    amplitude: float  # W, largest less smallest


def course_effect(name: str, courses: Mapping[str, tuple[float, int]]) -> Effect:
    """Power that follows the time of the recording alone; for fits beside it, never for a file."""
    count = max(2 * _HARMONICS if period else knots for period, knots in courses.values())

    def regressors(signals: Signals, **_: float) -> Floats:
        out = np.zeros((*signals.torque.shape, count))
        for column, drive in enumerate(signals.names):
            if drive in courses:
                own = course(signals.time, signals.recording, *courses[drive])
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


def course(time: Floats, recording: NDArray[np.int32], period: float, knots: int) -> Floats:
    """Columns [T, n] of a cycle, or of a drift by recording."""
    if period:
        angle = 2 * np.pi * (time - time[0]) / period
        waves = [f(h * angle) for h in range(1, _HARMONICS + 1) for f in (np.sin, np.cos)]
        return np.stack(waves, axis=1)
    out = np.zeros((len(time), knots))
    for one in np.unique(recording):
        rows = recording == one
        place = time[rows] - time[rows][0]
        place = place / max(place[-1], 1e-9) * (knots - 1)
        away = np.abs(place[:, None] - np.arange(knots))
        out[rows] = np.maximum(0.0, 1.0 - away)
    return out


def in_time(problem: DriveProblem, time: Floats, recording: NDArray[np.int32]) -> InTime | None:
    """Return the cycle or the drift that explains most of a drive's residual, if any does."""
    seconds = float(time[-1] - time[0])
    knots = int(np.clip(seconds / _KNOT, 3, 24))
    fine = int(np.clip(seconds / _SWITCH, 3, 3 * 24))
    tried = [(0.0, knots), (0.0, 3), (0.0, fine)]
    tried += [(period, 0) for period in _periods(problem, time)]
    best: InTime | None = None
    for period, count in tried:
        columns = course(time, recording, period, count)
        if not period:
            columns = columns - columns.mean(axis=0)
        moments = problem.moments(columns)
        own = moments.gram[-1][-columns.shape[1] :, -columns.shape[1] :]
        unit = max(float(np.trace(own)) / columns.shape[1], 1e-9)
        solved = problem.solve(moments, 1e-3 * unit * np.eye(columns.shape[1]))
        gain = problem.base_error - float(moments.error(solved[:-1]).sum()) / moments.rows
        shape = columns @ solved[-1][-columns.shape[1] :]
        if gain > 0.0 and (best is None or gain > 1.02 * best.gain):
            low, high = np.quantile(shape, (0.01, 0.99))
            best = InTime(problem.drive, period, count, gain, float(high - low))
    return best


def _periods(problem: DriveProblem, time: Floats) -> list[float]:
    """Periods of the strongest lines of the residual's means over half seconds, s."""
    mask = problem.blocks.mask[..., 0]
    left = np.where(mask, np.nan_to_num(problem.residual[problem.blocks.rows]), 0.0)
    half = left.shape[1] // 2
    if half == 0:
        return []
    parts = left[:, : 2 * half].reshape(len(left), 2, half)
    counts = mask[:, : 2 * half].reshape(len(left), 2, half).sum(axis=2)
    means = (parts.sum(axis=2) / np.maximum(counts, 1)).ravel()
    stamps = time[problem.blocks.rows[:, : 2 * half].reshape(len(left), 2, half)].mean(axis=2)
    stamps = stamps.ravel() - time[0]
    means = means - means.mean()
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
