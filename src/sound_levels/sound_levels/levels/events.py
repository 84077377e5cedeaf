"""Audible events of a recording: landings of feet, and a knock measured by the IMU."""

from dataclasses import dataclass

import numpy as np
from power_recordings.reading.reader import Recording
from wattwalk_core.arrays import Floats

RATE = 200.0  # Hz
_LANDED, _LIFTED = 40.0, 10.0  # N
_SWING = 0.05  # s, least time off the ground before a landing
_NEVER = -1e9  # s
_UNIQUE = 2.0  # ratio to the next largest jolt
_SEPARATION = 0.5  # s


@dataclass(frozen=True)
class Events:
    """
    Audible events, in s after the recording's start.

    loading: rate of increase of the feet's force, kN/s, at 200 Hz from `first` on; empty without
    foot_force. landings: times at which a foot touches down. knock: time of a single outstanding
    jolt of the IMU, else None.
    """

    seconds: float
    first: float
    loading: Floats
    landings: Floats
    knock: float | None


def events_of(recording: Recording) -> Events:
    """Return landings and jolts of a recording with or without foot_force and imu."""
    start = recording.start_ns
    loading, landings, first = np.zeros(0), np.zeros(0), 0.0
    if recording.has('foot_force'):
        feet = recording.foot_force()
        time = (feet.stamp_ns - start) / 1e9
        force = np.nan_to_num(feet.force.astype(np.float64))
        first = float(time[0])
        grid = np.arange(time[0], time[-1], 1.0 / RATE)
        rate = np.maximum(np.gradient(force, time, axis=0), 0.0).sum(axis=1) / 1e3
        total = np.concatenate([[0.0], np.cumsum(rate[:-1] * np.diff(time))])
        loading = np.diff(np.interp(grid, time, total), append=total[-1]) * RATE
        landings = np.sort(np.concatenate([_landings(time, foot) for foot in force.T]))
    knock = None
    if recording.has('imu'):
        imu = recording.imu()
        felt = np.linalg.norm(imu.linear_acceleration.astype(np.float64), axis=1)
        knock = _outstanding((imu.stamp_ns - start) / 1e9, np.abs(np.diff(felt, prepend=felt[0])))
    return Events(recording.duration, first, loading, landings, knock)


def _landings(time: Floats, force: Floats) -> Floats:
    """Return the times at which a foot is loaded after 50 ms off the ground."""
    down = np.flatnonzero((force[1:] >= _LANDED) & (force[:-1] < _LANDED)) + 1
    lifted = np.where(force <= _LIFTED, time, _NEVER)
    loaded = np.where(force > _LANDED, time, _NEVER)
    last_lifted = np.maximum.accumulate(lifted)
    last_loaded = np.maximum.accumulate(loaded)
    found = [t for t in down.tolist() if last_lifted[t - 1] - last_loaded[t - 1] >= _SWING]
    return time[found]


def _outstanding(time: Floats, jolt: Floats) -> float | None:
    """Return the time of the largest jolt if twice as large as any 0.5 s away from it."""
    peak = int(np.argmax(jolt))
    others = jolt[np.abs(time - time[peak]) > _SEPARATION]
    if not len(others) or jolt[peak] < _UNIQUE * max(float(others.max()), 1e-9):
        return None
    return float(time[peak])
