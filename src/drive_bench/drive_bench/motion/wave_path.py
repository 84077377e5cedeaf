"""Path of one joint through a segment that has a shape."""

import math

import numpy as np

from drive_bench.motion.segment_path import Mounting, Ramps, SegmentPath, Target, half_cosine
from drive_bench.motion.segments import Segment
from drive_bench.motion.waves import LevelSequence, Oscillation

_STEP = 1e-3  # s, of the integral of speed


class WavePath(SegmentPath):
    """
    Targets of a segment with a shape; in position mode after the way to its middle.

    Half cosines join levels of position, ramps those of speed and torque; squares of position and
    torque jump. Under torque commands the position is unknown beforehand.
    """

    def __init__(self, segment: Segment, start: float, mounting: Mounting, ramps: Ramps) -> None:
        super().__init__(segment, start, mounting, ramps)
        if segment.free:
            self.way_seconds, self.seconds = 0.0, segment.seconds
        abrupt = math.isinf(ramps.acceleration)
        self._wave: Oscillation | None = None
        self._levels: LevelSequence | None = None
        if segment.shape in ('sine', 'chirp'):
            lowest = segment.lowest if segment.shape == 'chirp' else 0.0
            self._wave = Oscillation(segment.frequency, segment.seconds, lowest, abrupt)
        else:
            self._levels = LevelSequence(segment.shape, segment.frequency)
            self.change_seconds = self._change(self._levels.widest)
        self._travel = np.zeros(1)
        if segment.mode == 'velocity':
            times = np.arange(0.0, segment.seconds + 2 * _STEP, _STEP)
            speeds = np.array([self._value(time) for time in times])
            self._travel = np.concatenate(
                ([0.0], np.cumsum(0.5 * _STEP * (speeds[1:] + speeds[:-1])))
            )

    @property
    def rung(self) -> float:
        """Duration of a level, s; infinite for other shapes."""
        return math.inf if self._levels is None else min(self._levels.rung, self.segment.seconds)

    @property
    def extent(self) -> tuple[float, float]:
        """Lowest and highest target, rad; of a torque only where it begins."""
        if self.segment.free:
            return (
                self._start + float(self._travel.min()),
                self._start + float(self._travel.max()),
            )
        swing = abs(self.segment.amplitude)
        ends = (self._start, self._goal - swing, self._goal + swing)
        return min(ends), max(ends)

    def at(self, time: float) -> Target:
        """Return the target at a time, s."""
        mode = self.segment.mode
        if mode == 'torque':
            return Target(self._start, effort=self._value(time), mode=mode)
        if mode == 'velocity':
            place = min(max(time, 0.0) / _STEP, len(self._travel) - 1.0)
            travel = float(np.interp(place, np.arange(len(self._travel)), self._travel))
            return Target(self._start + travel, self._value(time), mode=mode)
        if time < self.way_seconds:
            return self._on_the_way(time)
        since = time - self.way_seconds
        if self._wave is not None:
            return Target(self._goal + self.segment.amplitude * self._wave.at(since))
        return self._stepping(since)

    def _stepping(self, since: float) -> Target:
        assert self._levels is not None
        before, level, within = self._levels.at(since)
        size = self.segment.amplitude
        seconds = self._change(abs(level - before))
        if within >= seconds:
            return Target(self._goal + size * level)
        place, speed = half_cosine(within / seconds)
        change = size * (level - before)
        return Target(self._goal + size * before + change * place, change * speed / seconds)

    def _value(self, time: float) -> float:
        """Return speed, rad/s, or torque, N·m, of a drive that is not in position mode."""
        size = self.segment.amplitude
        if self._wave is not None:
            return size * self._wave.at(min(time, self.segment.seconds))
        assert self._levels is not None
        before, level, within = self._levels.at(time)
        seconds = self._change(abs(level - before))
        share = 1.0 if within >= seconds else within / seconds
        value = size * (before + share * (level - before))
        slope = self._slope
        if math.isinf(slope):
            return value
        left = slope * max(self.segment.seconds - time, 0.0)
        return math.copysign(min(abs(value), left), value)

    @property
    def _slope(self) -> float:
        """Slope between levels, rad/s² or N·m/s."""
        if self.segment.mode == 'velocity':
            return self._ramps.acceleration
        return math.inf if self.segment.shape == 'square' else self._ramps.torque

    def _change(self, share: float) -> float:
        """Return the duration of a change by a share of the amplitude, s."""
        distance = share * abs(self.segment.amplitude)
        if self.segment.free:
            return distance / self._slope
        return 0.0 if self.segment.shape == 'square' else self._ramps.way_seconds(distance)
