"""Response of current and torque to steps of the command, stacked at the commands' stamps."""

from dataclasses import dataclass

import numpy as np
from power_recordings.messages.samples import JointSamples
from power_recordings.reading.reader import Recording
from wattwalk_core.arrays import Floats, Singles, Stamps

from power_calibration.analyser.reference_fit import IntervalEstimate

_BEFORE, _AFTER = 0.02, 0.04  # s around a step
_REST_NS = 100_000_000  # without another step before and after
_FEWEST = 5
_DRAWS = 400
_GRID = 2.5e-4  # s
_FIELDS = ('position', 'velocity', 'effort')


@dataclass(frozen=True)
class StepResponse:
    """Mean response of one drive to steps of its command, aligned at the commands' stamps.

    time: s after the step [G]; current and torque: mean change relative to that 40 ms after the
    step [G]. current_half, torque_half: time, s, at which each reaches half of it.
    """

    drive: str
    events: int
    time: Floats
    current: Floats
    torque: Floats
    current_half: IntervalEstimate
    torque_half: IntervalEstimate


def step_response(recording: Recording, drive: str) -> StepResponse | None:
    """Average the responses to steps of a drive's command; None for under five isolated steps.

    A step is a change by over a quarter of the command's range from one message to the next. The
    command is constant within 2 % of its range for 0.1 s before and after.
    """
    if not recording.has('joint_commands') or not recording.has('joint_states'):
        return None
    steps = _steps(recording.joint_commands(), drive)
    supply, joints = recording.drive_supply(), recording.joint_states()
    if len(steps) < _FEWEST or drive not in supply.names or drive not in joints.names:
        return None
    grid = np.arange(-_BEFORE, _AFTER + _GRID, _GRID)
    signals = (
        (supply.stamp_ns, supply.current[:, supply.names.index(drive)]),
        (joints.stamp_ns, joints.effort[:, joints.names.index(drive)]),
    )
    pairs = [[_around(*signal, stamp, grid) for signal in signals] for stamp in steps]
    rows = [pair for pair in pairs if all(part is not None for part in pair)]
    if len(rows) < _FEWEST:
        return None
    stacked = np.array(rows)  # [E, 2, G]
    random = np.random.default_rng(0)
    picks = random.integers(0, len(rows), (_DRAWS, len(rows)))
    halves = []
    for channel in (0, 1):
        middle = _half(grid, stacked[:, channel])
        drawn = [_half(grid, stacked[pick, channel]) for pick in picks]
        low, high = np.nanquantile(drawn, (0.025, 0.975)).tolist()
        halves.append(IntervalEstimate(middle, low, high))
    means = [_normalised(stacked[:, channel]) for channel in (0, 1)]
    return StepResponse(drive, len(rows), grid, means[0], means[1], halves[0], halves[1])


def _steps(commands: JointSamples, drive: str) -> Stamps:
    """Return the stamps of isolated steps of the quantity that has the most of them."""
    if drive not in commands.names:
        return np.zeros(0, np.int64)
    column = commands.names.index(drive)
    found = [np.zeros(0, np.int64)]
    for name in _FIELDS:
        values = getattr(commands, name)[:, column].astype(np.float64)
        given = np.isfinite(values)
        if given.sum() > 8 and np.ptp(values[given]) > 0.0:
            found.append(_alone(commands.stamp_ns[given], values[given]))
    return max(found, key=len)


def _alone(stamps: Stamps, values: Floats) -> Stamps:
    """Return the stamps of steps without another change around them."""
    change = np.abs(np.diff(values))
    wide = float(np.ptp(values))
    large = np.flatnonzero(change > 0.25 * wide) + 1
    first, last = (np.searchsorted(stamps, stamps[large] + side) for side in (-_REST_NS, _REST_NS))
    alone = [
        float(change[low : step - 1].sum() + change[step : high - 1].sum()) < 0.02 * wide
        for low, step, high in zip(first, large, last, strict=True)
    ]
    return np.asarray(stamps[large[alone]], np.int64)


def _around(stamps: Stamps, values: Singles, at: np.int64, grid: Floats) -> Floats | None:
    """Return a signal around an event, less its level before; None where samples lack."""
    span = np.array([-_BEFORE - 0.01, _AFTER + 0.01]) * 1e9
    low, high = np.searchsorted(stamps, at + span.astype(np.int64)).tolist()
    part = values[low:high].astype(np.float64)
    time = (stamps[low:high] - at) / 1e9
    enough = len(time) > 8 and time[0] < grid[0] and time[-1] > grid[-1]
    if not enough or not np.isfinite(part).all() or np.diff(time).max() > 0.006:
        return None
    return np.interp(grid, time, part) - part[time < 0].mean()


def _normalised(rows: Floats) -> Floats:
    """Return the mean of changes [E, G] of either sign, scaled to 1 at the end."""
    late = rows[:, -len(rows[0]) // 6 :].mean(axis=1)
    signs = np.sign(late)
    mean = (rows * signs[:, None]).mean(axis=0)
    scale = float(mean[-len(mean) // 6 :].mean())
    normal: Floats = mean / scale if scale > 0 else mean * np.nan
    return normal


def _half(grid: Floats, rows: Floats) -> float:
    """Return when the mean first passes half of its final value, s; NaN if it does not."""
    mean = _normalised(rows)
    above = np.flatnonzero((mean[1:] >= 0.5) & (mean[:-1] < 0.5))
    if not len(above):
        return np.nan
    place = int(above[0])
    share = (0.5 - mean[place]) / (mean[place + 1] - mean[place])
    return float(grid[place] + share * (grid[place + 1] - grid[place]))
