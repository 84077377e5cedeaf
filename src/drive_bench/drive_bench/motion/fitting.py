"""Adaptation of motions to joint limits: shorter passes, smaller swings, lower torques."""

import math
from dataclasses import replace

from drive_bench.motion.file import MotionFile
from drive_bench.motion.joint_limits import ROUNDING, JointLimits
from drive_bench.motion.plan import path_of
from drive_bench.motion.segment_path import Mounting, Ramps
from drive_bench.motion.segments import Segment

_MARGIN = 0.05  # rad from the limits
_LEAST_RAMPS = 2.5  # of the time to gain a speed: shorter passes are refused
_LOAD_SHARE = 0.95  # of what a pendulum pulls


def fitted(
    motion: MotionFile,
    start: float,
    mounting: Mounting,
    limits: JointLimits,
    ramps: Ramps | None = None,
) -> tuple[MotionFile, tuple[str, ...]]:
    """Return a motion adapted to a joint's limits, and sentences on the changes.

    start: position, rad. Passes there and back are split into shorter ones of the same total
    duration; swings, speeds and torques are reduced. `Plan.check` refuses what still exceeds.
    """
    fitter = _Fitter(start, mounting, limits, ramps or Ramps())
    segments = list(motion.segments)
    while segments:
        there = segments.pop(0)
        if there.turns and segments[:1] == [replace(there, speed=-there.speed)]:
            fitter.pair(there)
            del segments[0]
        else:
            fitter.single(there)
    return replace(motion, segments=tuple(fitter.segments)), tuple(fitter.notes)


class _Fitter:
    def __init__(
        self, position: float, mounting: Mounting, limits: JointLimits, ramps: Ramps
    ) -> None:
        self.segments: list[Segment] = []
        self.notes: list[str] = []
        self._position, self._mounting = position, mounting
        self._limits, self._ramps = limits, ramps

    def pair(self, there: Segment) -> None:
        """Add passes there and back."""
        asked, there = there, self._capped(there)
        up, down = self._limits.high - self._position, self._position - self._limits.low
        ahead, behind = (up, down) if there.speed > 0.0 else (down, up)
        if self._travel(there) > ahead - _MARGIN:
            if behind > ahead:
                there = replace(there, speed=-there.speed)
            room = max(ahead, behind) - _MARGIN
            if room > 0.0:
                self._cut(asked, there, room)
                return
        self.segments += [there, replace(there, speed=-there.speed)]

    def _travel(self, segment: Segment) -> float:
        speed = abs(segment.speed)
        return speed * (segment.seconds - speed / self._ramps.acceleration)

    def _cut(self, asked: Segment, there: Segment, room: float) -> None:
        """Add passes within room, rad, each long enough to accelerate and brake."""
        acceleration = self._ramps.acceleration
        fastest = math.sqrt(room * acceleration / (_LEAST_RAMPS - 1.0))
        speed = math.copysign(min(abs(there.speed), fastest), there.speed)
        longest = room / abs(speed) + abs(speed) / acceleration
        count = math.ceil(there.seconds / longest)
        seconds = math.floor(1e3 * there.seconds / count) / 1e3
        seconds = max(seconds, min(longest, _LEAST_RAMPS * abs(speed) / acceleration))
        each = replace(there, speed=speed, seconds=seconds)
        self.segments += [each, replace(each, speed=-speed)] * count
        self.notes.append(
            f'{asked} and back: {count} times {each.seconds:.2f} s, first to {speed:+.3g} rad/s'
        )

    def single(self, segment: Segment) -> None:
        """Add any other segment."""
        fit = self._within(self._capped(segment))
        self.segments.append(fit)
        self._position = path_of(fit, self._position, self._mounting, self._ramps).end

    def _within(self, segment: Segment) -> Segment:
        """Return the segment with an amplitude or a duration within the joint's range."""
        path = path_of(segment, self._position, self._mounting, self._ramps)
        low, high = path.extent
        room_up = self._limits.high - _MARGIN
        room_down = self._limits.low + _MARGIN
        if low >= self._limits.low - ROUNDING and high <= self._limits.high + ROUNDING:
            return segment
        if segment.turns:
            edge = room_up if segment.speed > 0.0 else room_down
            seconds = (edge - self._position) / segment.speed
            if seconds <= _LEAST_RAMPS * path.turn_seconds:
                return segment
            self.notes.append(f'{segment}: only {seconds:.2f} s')
            return replace(segment, seconds=seconds)
        if not segment.waves:
            return segment
        middle = self._position if segment.free else 0.5 * (low + high)
        over = max((high - middle) / (room_up - middle), (middle - low) / (middle - room_down))
        if not (room_down < middle < room_up and over > 1.0):
            return segment
        return self._lowered(segment, abs(segment.amplitude) / over)

    def _capped(self, segment: Segment) -> Segment:
        """Return the segment within the joint's speed and torque and the load's pull."""
        limits, pull = self._limits, self._mounting.pendulum
        if segment.turns and abs(segment.speed) > limits.speed:
            self.notes.append(f'{segment}: only {limits.speed:g} rad/s')
            segment = replace(segment, speed=math.copysign(limits.speed, segment.speed))
        too_fast = segment.fastest > limits.speed * (1.0 + ROUNDING)
        if too_fast and segment.waves and not segment.saturate:
            amplitude = abs(segment.amplitude) * limits.speed / segment.fastest
            segment = self._lowered(segment, amplitude)
        most = min(limits.torque, _LOAD_SHARE * pull if pull else math.inf)
        if segment.strongest > most:
            self.notes.append(f'{segment}: at most {most:.3g} N·m')
            names = ('load', 'torque', 'low', 'high')
            kept = {name: max(-most, min(most, getattr(segment, name))) for name in names}
            segment = replace(segment, **kept)
            if segment.free and segment.mode == 'torque':
                segment = replace(segment, amplitude=math.copysign(most, segment.amplitude))
        return segment

    def _lowered(self, segment: Segment, amplitude: float) -> Segment:
        if not math.isfinite(amplitude) or amplitude <= 0.0:
            return segment
        self.notes.append(f'{segment}: amplitude {amplitude:.3g}')
        return replace(segment, amplitude=math.copysign(amplitude, segment.amplitude))
