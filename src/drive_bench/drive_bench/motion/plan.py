"""Path of one joint through a motion, and its check against the limits."""

import math
from bisect import bisect_right
from dataclasses import replace
from itertools import accumulate

import numpy as np
from wattwalk_core.errors import InputError

from drive_bench.motion.file import MotionFile
from drive_bench.motion.joint_limits import ROUNDING, JointLimits
from drive_bench.motion.segment_path import (
    JUMPS,
    Mounting,
    Ramps,
    SegmentPath,
    Target,
    half_cosine,
)
from drive_bench.motion.segments import LevelSequence, Oscillation, Segment

_STEP = 1e-3  # s, of the integral of speed


class WavePath(SegmentPath):
    """Targets of a segment with a shape or swing, after a transition to its middle position.

    Half cosines join levels of position, ramps those of speed and torque; squares of position and
    torque jump. Under torque commands the position is unknown beforehand.
    """

    def __init__(self, segment: Segment, start: float, mounting: Mounting, ramps: Ramps) -> None:
        super().__init__(segment, start, mounting, ramps)
        if segment.free:
            self.way_seconds, self.seconds = 0.0, segment.seconds
        abrupt = math.isinf(ramps.acceleration)
        self._shape: Oscillation | LevelSequence
        self.rung = math.inf
        """Duration of a level, s; infinite for other shapes."""
        if segment.swings or segment.shape in ('sine', 'chirp'):
            lowest = segment.lowest if segment.shape == 'chirp' else 0.0
            self._shape = Oscillation(segment.frequency, segment.seconds, lowest, abrupt)
        else:
            self._shape = LevelSequence(segment.shape, segment.frequency)
            self.change_seconds = self._change(self._shape.widest)
            self.rung = min(self._shape.rung, segment.seconds)
        self._travel = np.zeros(1)
        if segment.mode == 'velocity':
            times = np.arange(0.0, segment.seconds + 2 * _STEP, _STEP)
            speeds = np.array([self._value(time) for time in times])
            ways = np.cumsum(0.5 * _STEP * (speeds[1:] + speeds[:-1]))
            self._travel = np.concatenate(([0.0], ways))

    @property
    def extent(self) -> tuple[float, float]:
        """Lowest and highest target, rad; in torque mode the initial position alone."""
        if self.segment.free:
            return (
                self._start + float(self._travel.min()),
                self._start + float(self._travel.max()),
            )
        swing = abs(self.segment.amplitude)
        ends = (self._start, self._goal - swing, self._goal + swing)
        return min(ends), max(ends)

    def at(self, time: float) -> Target:
        """Return the target at a time, s after the segment's start."""
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
        size = self.segment.amplitude
        if isinstance(self._shape, Oscillation):
            return Target(self._goal + size * self._shape.at(since))
        before, level, within = self._shape.at(since)
        seconds = self._change(abs(level - before))
        if within >= seconds:
            return Target(self._goal + size * level)
        place, speed = half_cosine(within / seconds)
        change = size * (level - before)
        return Target(self._goal + size * before + change * place, change * speed / seconds)

    def _value(self, time: float) -> float:
        """Return speed, rad/s, or torque, N·m, of a drive that is not in position mode."""
        size = self.segment.amplitude
        if isinstance(self._shape, Oscillation):
            return size * self._shape.at(min(time, self.segment.seconds))
        before, level, within = self._shape.at(time)
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


class Plan:
    """Targets of a whole motion for a joint that starts at a position, rad.

    Unless `ramps` is JUMPS, swings fade in and out within a period. At the end the joint returns
    to where it carries no load.
    """

    def __init__(
        self, motion: MotionFile, start: float, mounting: Mounting, ramps: Ramps = JUMPS
    ) -> None:
        self._mounting, self._ramps, self._segments = mounting, ramps, motion.segments
        self.paths: list[SegmentPath] = []
        self.begin_anew(0, start)

    def begin_anew(self, first: int, start: float) -> None:
        """Plan the segments from index `first` on again, starting at a position, rad."""
        del self.paths[first:]
        position, free = start, False
        for segment in self._segments[first:]:
            path = path_of(segment, position, self._mounting, self._ramps)
            self.paths.append(path)
            position, free = path.end, segment.free
        back = SegmentPath(Segment('rest', 0.0), position, self._mounting, self._ramps)
        if back.seconds > 0.0 or free or not self.paths[first:]:
            self.paths.append(back)
        lengths = (path.seconds for path in self.paths)
        *self._begins, self.seconds = accumulate(lengths, initial=0.0)

    def place(self, time: float) -> int:
        """Return the index of the segment at a time, s."""
        return max(bisect_right(self._begins, time) - 1, 0)

    def at(self, time: float) -> Target:
        """Return the target at a time, s; after the end the last one."""
        index = self.place(time)
        path = self.paths[index]
        return path.at(min(max(time - self._begins[index], 0.0), path.seconds))

    def skip(self, time: float) -> float:
        """Return the time, s, by which the present segment can be shortened without a jump."""
        index = self.place(time)
        return self.paths[index].skip(time - self._begins[index])

    def check(self, drive: str, limits: JointLimits) -> None:
        """Raise InputError for the first segment that exceeds limits or does not suit the load."""
        for number, path in enumerate(self.paths[: len(self._segments)], 1):
            where = f'segment {number} ({path.segment})'
            for value, most, unit, exempt in (
                (path.segment.fastest, limits.speed, 'rad/s', path.segment.saturate),
                (path.segment.strongest, limits.torque, 'N·m', False),
            ):
                if value > most * (1.0 + ROUNDING) and not exempt:
                    raise InputError(
                        f'{where}: {value:.4g} {unit} asked of {drive}; its limits are '
                        f'0..{most:g} {unit}'
                    )
            _check_mounting(path.segment, self._mounting, where)
            self._check_time(path, where)
            for value in path.extent:
                if not limits.low - ROUNDING <= value <= limits.high + ROUNDING:
                    raise InputError(
                        f'{where}: {drive} would go to {value:.2f} rad; its limits are '
                        f'{limits.low:.2f}..{limits.high:.2f} rad (--fit shortens it)'
                    )

    def _check_time(self, path: SegmentPath, where: str) -> None:
        seconds = path.segment.seconds
        if isinstance(path, WavePath) and 2.0 * path.change_seconds > path.rung:
            raise InputError(
                f'{where}: it takes {path.change_seconds:.2f} s from level to level; hold each at '
                'least twice as long, or lower the amplitude'
            )
        if 2.0 * path.turn_seconds > 0.8 * seconds:
            raise InputError(
                f'{where}: too short to gain and lose this speed; give it at least '
                f'{2.5 * path.turn_seconds:.2f} s'
            )
        if path.segment.alternates and path.change_seconds > 0.25 / path.segment.frequency:
            raise InputError(
                f'{where}: the pendulum takes {path.change_seconds:.2f} s from one torque to the '
                f'other; lock the joint (--locked), or at most '
                f'{0.25 / path.change_seconds:.2f} Hz'
            )


def _check_mounting(segment: Segment, mounting: Mounting, where: str) -> None:
    if mounting.locked:
        if segment.turns or segment.swings or (segment.shape and segment.mode != 'torque'):
            raise InputError(f'{where}: a locked joint cannot move; leave the segment out')
    elif segment.free and segment.mode == 'torque':
        if 0.0 < mounting.pendulum < segment.strongest:
            raise InputError(
                f'{where}: {segment.strongest:g} N·m carry a pendulum of {mounting.pendulum:g} '
                'N·m over the top; lower the amplitude'
            )
    elif segment.strongest > mounting.pendulum:
        has = f'{mounting.pendulum:g} N·m' if mounting.pendulum else 'none'
        raise InputError(
            f'{where}: needs a load of up to {segment.strongest:g} N·m, given is {has}; hang a '
            'pendulum that is heavy enough and give its pull at a right angle (--pendulum), or '
            'lock the joint (--locked)'
        )


def path_of(segment: Segment, start: float, mounting: Mounting, ramps: Ramps) -> SegmentPath:
    """Return the path of one segment for a joint that starts at a position, rad."""
    kind = WavePath if segment.waves else SegmentPath
    return kind(_settled(segment), start, mounting, ramps)


def _settled(segment: Segment) -> Segment:
    """Return a segment that turns at speed 0 as one that holds the load."""
    if segment.mode == 'velocity' and not (segment.turns or segment.shape):
        return replace(segment, mode='torque', torque=segment.load, frequency=0.0)
    return segment


class SegmentPlayer:
    """Player of a motion for a joint that starts at a position, rad.

    After a segment in velocity or torque mode the rest is planned again from the measured
    position. A segment with until_warmer ends once the winding is that much warmer than at the
    start.
    """

    def __init__(self, motion: MotionFile, start: float, mounting: Mounting, ramps: Ramps) -> None:
        self.plan = Plan(motion, start, mounting, ramps)
        self.motion = motion
        self.elapsed = 0.0
        self.place = 0  # of the segment; the return at the end counts as one
        self._initial: float | None = None
        self._warmed: int | None = None

    @property
    def left(self) -> float:
        """Remaining time, s; an upper bound for segments with until_warmer."""
        return max(self.plan.seconds - self.elapsed, 0.0)

    @property
    def segment(self) -> Segment:
        """The present segment."""
        return self.plan.paths[self.place].segment

    @property
    def needs_temperature(self) -> bool:
        """True if the end of the segment depends on the winding temperature."""
        return bool(self.segment.until_warmer) and self._warmed != self.place

    def step(self, seconds: float, position: float, temperature: float = math.nan) -> Target:
        """Advance by some seconds and return the target; measured: rad and °C."""
        self.elapsed += seconds
        self._end_when_warm(temperature)
        place = self.plan.place(self.elapsed)
        if place != self.place:
            if self.segment.free:
                place = self.place + 1
                self.plan.begin_anew(place, position)
            self.place = place
        return self.plan.at(self.elapsed)

    def _end_when_warm(self, temperature: float) -> None:
        if math.isnan(temperature):
            return
        self._initial = temperature if self._initial is None else self._initial
        warm = temperature - self._initial >= self.segment.until_warmer
        if self.needs_temperature and (warm or temperature >= self.segment.hottest):
            leap = self.plan.skip(self.elapsed)
            self.elapsed += leap
            if leap:
                self._warmed = self.place
