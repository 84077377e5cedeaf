"""Stamps of each stream: rate, jitter, losses, and the clock of the device."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from power_recordings.messages.samples import DriveSamples, Samples
from power_recordings.reading.reader import Recording

Floats = NDArray[np.float64]
_TOPICS = (
    *('drive_supply', 'joint_states', 'joint_commands', 'supply'),
    *('imu', 'odom', 'foot_force', 'power_estimate'),
)
_WINDOW = 10.0  # s, within which a clock counts as even
_GAP = 2.5  # periods


@dataclass(frozen=True)
class StampQuality:
    """
    Regularity of the stamps of a stream of N samples.

    jitter: deviation from an even clock, fitted per 10 s, in s [N]; NaN in windows of under 8.
    lost: samples missing by sequence numbers, else by gaps.
    """

    topic: str
    count: int
    rate: float  # Hz
    time: Floats  # s [N], after the first
    jitter: Floats
    lost: int
    gaps: int
    by_sequence: bool

    @property
    def spread(self) -> float:
        """Standard deviation of the jitter, s."""
        return float(np.nanstd(self.jitter)) if np.isfinite(self.jitter).any() else np.nan

    @property
    def worst(self) -> float:
        """99th percentile of the jitter's magnitude, s."""
        known = np.abs(self.jitter[np.isfinite(self.jitter)])
        return float(np.quantile(known, 0.99)) if len(known) else np.nan


@dataclass(frozen=True)
class ClockQuality:
    """
    Mapping from the device's clock to stamps.

    residual: deviation of stamps from a straight line over device time, s [N], which includes slow
    changes of a clock. drift: by how much the device's clock runs too fast, ppm.
    """

    drift: float
    time: Floats
    residual: Floats

    @property
    def spread(self) -> float:
        """Standard deviation of the residual, s."""
        return float(self.residual.std())

    @property
    def worst(self) -> float:
        """99th percentile of the residual's magnitude, s."""
        return float(np.quantile(np.abs(self.residual), 0.99))


def stamp_qualities(recording: Recording) -> list[StampQuality]:
    """Return the quality of each stream with at least four samples."""
    found = []
    for topic in _TOPICS:
        if not recording.has(topic):
            continue
        samples = getattr(recording, topic)()
        if len(samples) >= 4:
            found.append(_quality(topic, samples))
    return found


def _quality(topic: str, samples: Samples) -> StampQuality:
    time = (samples.stamp_ns - samples.stamp_ns[0]) / 1e9
    steps = np.diff(time)
    period = float(np.median(steps))
    if isinstance(samples, DriveSamples):
        index = (samples.sequence - samples.sequence[0]).astype(np.int64)
        lost, gaps, counted = samples.lost, int(samples.after_gap.sum()), True
    else:
        missing = np.where(steps > _GAP * period, np.rint(steps / period) - 1, 0)
        lost, gaps, counted = int(missing.sum()), int((missing > 0).sum()), False
        index = np.concatenate([[0], np.cumsum(1 + missing)]).astype(np.int64)
    rate = float((index[-1] - index[0]) / (time[-1] - time[0]))
    return StampQuality(topic, len(samples), rate, time, _jitter(time, index), lost, gaps, counted)


def _jitter(time: Floats, index: NDArray[np.int64]) -> Floats:
    jitter = np.full(len(time), np.nan)
    window = (time / _WINDOW).astype(np.int64)
    for number in range(int(window[-1]) + 1):
        rows = np.flatnonzero(window == number)
        if len(rows) >= 8:
            slope, origin = np.polyfit(index[rows] - index[rows[0]], time[rows], 1)
            jitter[rows] = time[rows] - origin - slope * (index[rows] - index[rows[0]])
    return jitter


def clock_quality(recording: Recording) -> ClockQuality | None:
    """Return the clock mapping of drive_supply, whose messages carry device time; else None."""
    if not recording.has('drive_supply'):
        return None
    supply = recording.drive_supply()
    device = (supply.device_time.astype(np.int64) - int(supply.device_time[0])) / 1e9
    time = (supply.stamp_ns - supply.stamp_ns[0]) / 1e9
    if len(supply) < 8 or device[-1] <= 0 or (np.diff(device) < 0).any():
        return None
    slope, origin = np.polyfit(device, time - device, 1)
    return ClockQuality(-1e6 * slope, time, time - device - origin - slope * device)
