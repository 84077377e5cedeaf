"""
The path of one joint through a motion file, and whether that path may be driven.

How a load is put on is a matter of what the drive turns (Mounting). With a pendulum or a hung leg
the load is what gravity gives: a held torque is the angle at which it pulls as much, and at speed
the load swings as the pendulum goes round. With a locked joint the drive itself pushes.
"""

import math
from bisect import bisect_right
from dataclasses import dataclass, replace
from typing import Final

from policy_runner.errors import InputError
from policy_runner.excitation import MotionFile, Segment
from policy_runner.joint_limits import JointLimits


@dataclass(frozen=True)
class Mounting:
    """
    What a drive turns.

    pendulum: torque with which gravity pulls at a right angle, N·m; 0 for none. hanging: angle at
    which it hangs, rad. locked: the joint cannot turn. InputError for what cannot be.
    """

    pendulum: float = 0.0
    hanging: float = 0.0
    locked: bool = False

    def __post_init__(self) -> None:
        if not 0.0 <= self.pendulum <= 1000.0:
            raise InputError(f'the pendulum is {self.pendulum!r}; it must be 0..1000 N·m')
        if not abs(self.hanging) <= 100.0:
            raise InputError(f'the hanging angle is {self.hanging!r}; it must be -100..100 rad')
        if self.locked and self.pendulum:
            raise InputError('a locked joint swings no pendulum; give one of the two')

    def angle(self, torque: float) -> float:
        """Angle from hanging, rad, at which the drive holds a torque, N·m, against gravity."""
        if self.locked or not self.pendulum:
            return 0.0
        return math.asin(max(-1.0, min(1.0, torque / self.pendulum)))

    def middle(self, position: float) -> float:
        """Where the joint carries no load, next to a position, rad."""
        if not self.pendulum:
            return position
        turn = 2.0 * math.pi
        return self.hanging + turn * round((position - self.hanging) / turn)


@dataclass(frozen=True)
class Ramps:
    """
    How a joint is led from one target to the next.

    way: largest speed on the way to where a segment begins, rad/s. acceleration: of what a
    segment asks for, rad/s². torque: N·m/s at which a locked joint is loaded.
    """

    way: float = 1.0
    acceleration: float = 40.0
    torque: float = 40.0

    def way_seconds(self, distance: float) -> float:
        """Time of a way, s: a half cosine whose greatest speed and acceleration keep to these."""
        d = abs(distance)
        by_speed = 0.5 * math.pi * d / self.way
        return max(by_speed, math.pi * math.sqrt(0.5 * d / self.acceleration))


JUMPS: Final = Ramps(math.inf, math.inf, math.inf)
"""Targets that jump, for simulated drives that take no harm."""


@dataclass(frozen=True)
class Target:
    """What a drive is told: position, rad, with velocity, rad/s, and effort, N·m, fed forward."""

    position: float
    velocity: float = 0.0
    effort: float = 0.0


class Path:
    """The targets of one segment; time counts from its start."""

    def __init__(self, segment: Segment, start: float, mounting: Mounting, ramps: Ramps) -> None:
        self.segment = segment
        self._start, self._ramps, self._locked = start, ramps, mounting.locked
        middle = mounting.middle(start)
        first = segment.high if segment.alternates else segment.held
        self._goal = start if segment.turns else middle + mounting.angle(first)
        self._low = middle + mounting.angle(segment.low)
        self._way = self._goal - start
        self.way_seconds = ramps.way_seconds(self._way)
        if mounting.locked:
            self.way_seconds = abs(first) / ramps.torque
        self.turn_seconds = abs(segment.speed) / ramps.acceleration if segment.turns else 0.0
        self.change_seconds = 0.0
        if segment.alternates and not mounting.locked:
            self.change_seconds = ramps.way_seconds(self._low - self._goal)

    @property
    def end(self) -> float:
        """The last target, rad."""
        return self.at(self.segment.seconds).position

    @property
    def extent(self) -> tuple[float, float]:
        """Lowest and highest target, rad."""
        swing = abs(self.segment.amplitude) if self.segment.swings else 0.0
        ends = [self._start, self._goal - swing, self._goal + swing, self.end]
        if self.segment.alternates:
            ends.append(self._low)
        return min(ends), max(ends)

    def at(self, time: float) -> Target:
        """The target at a time, s."""
        segment = self.segment
        if segment.turns:
            return self._turning(time)
        if time < self.way_seconds:
            return self._on_the_way(time)
        since = time - self.way_seconds
        if segment.swings:
            turns = segment.frequency * since
            share = 1.0 if math.isinf(self._ramps.acceleration) else min(1.0, turns)
            swing = share * segment.amplitude * math.sin(2.0 * math.pi * turns)
            return Target(self._goal + swing)
        if segment.alternates:
            return self._alternating(since)
        return Target(self._goal, effort=segment.held if self._locked else 0.0)

    def _on_the_way(self, time: float) -> Target:
        share = time / self.way_seconds
        if self._locked:
            first = self.segment.high if self.segment.alternates else self.segment.held
            return Target(self._start, effort=share * first)
        place, speed = _half_cosine(share)
        return Target(self._start + self._way * place, self._way * speed / self.way_seconds)

    def _turning(self, time: float) -> Target:
        ramp, speed = self.turn_seconds, self.segment.speed
        left = self.segment.seconds - time
        if time < ramp:
            return Target(self._start + 0.5 * speed * time * time / ramp, speed * time / ramp)
        if left >= ramp:
            return Target(self._start + speed * (time - 0.5 * ramp), speed)
        whole = speed * (self.segment.seconds - ramp)
        left = max(left, 0.0)
        return Target(self._start + whole - 0.5 * speed * left * left / ramp, speed * left / ramp)

    def _alternating(self, since: float) -> Target:
        half = 0.5 / self.segment.frequency
        count = int(since / half)
        up = count % 2 == 0
        if self._locked:
            return Target(self._goal, effort=self.segment.high if up else self.segment.low)
        there, back = (self._goal, self._low) if up else (self._low, self._goal)
        within = since - count * half
        if count == 0 or within >= self.change_seconds:
            return Target(there)
        place, speed = _half_cosine(within / self.change_seconds)
        return Target(back + (there - back) * place, (there - back) * speed / self.change_seconds)


class Plan:
    """The targets of a whole motion for a joint that starts at a position, rad."""

    def __init__(
        self, motion: MotionFile, start: float, mounting: Mounting, ramps: Ramps = JUMPS
    ) -> None:
        self._mounting, self._ramps = mounting, ramps
        self.paths: list[Path] = []
        self._begins: list[float] = []
        begin, position = 0.0, start
        for segment in motion.segments:
            path = Path(_settled(segment), position, mounting, ramps)
            self.paths.append(path)
            self._begins.append(begin)
            begin, position = begin + segment.seconds, path.end
        self.seconds = begin

    def place(self, time: float) -> int:
        """Index of the segment at a time, s; the last one from its start on."""
        return max(bisect_right(self._begins, time) - 1, 0)

    def at(self, time: float) -> Target:
        """The target at a time, s; afterwards the last one."""
        index = self.place(time)
        path = self.paths[index]
        return path.at(min(max(time - self._begins[index], 0.0), path.segment.seconds))

    def check(self, drive: str, limits: JointLimits) -> None:
        """InputError for the first segment that a drive cannot or may not be put through."""
        for number, path in enumerate(self.paths, 1):
            where = f'segment {number} ({path.segment})'
            for value, most, unit in (
                (path.segment.fastest, limits.speed, 'rad/s'),
                (path.segment.strongest, limits.torque, 'N·m'),
            ):
                if value > most:
                    raise InputError(
                        f'{where}: {value:.4g} {unit} asked of {drive}; its limits are '
                        f'0..{most:g} {unit}'
                    )
            _check_mounting(path.segment, self._mounting, where)
            self._check_time(path, where)
            for value in path.extent:
                if not limits.low <= value <= limits.high:
                    raise InputError(
                        f'{where}: {drive} would go to {value:.2f} rad; its limits are '
                        f'{limits.low:.2f}..{limits.high:.2f} rad'
                    )

    def _check_time(self, path: Path, where: str) -> None:
        seconds = path.segment.seconds
        if path.way_seconds > 0.5 * seconds:
            raise InputError(
                f'{where}: it takes {path.way_seconds:.2f} s to where it begins; give it at '
                f'least {2.0 * path.way_seconds:.2f} s'
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
        if segment.turns or segment.swings:
            raise InputError(f'{where}: a locked joint cannot move; leave the segment out')
    elif segment.strongest > mounting.pendulum:
        has = (
            f'pulls with {mounting.pendulum:g} N·m at most'
            if mounting.pendulum
            else 'is not there'
        )
        raise InputError(
            f'{where}: needs a load of {segment.strongest:g} N·m, but the pendulum {has}; hang '
            'a heavier one and say so (--pendulum, N·m at a right angle), or lock the joint '
            '(--locked)'
        )


def _settled(segment: Segment) -> Segment:
    """Turning at speed 0 is holding the load."""
    if segment.mode == 'velocity' and not segment.turns:
        return replace(segment, mode='torque', torque=segment.load, frequency=0.0)
    return segment


def _half_cosine(share: float) -> tuple[float, float]:
    """Place 0..1 and its derivative at a share 0..1 of the time."""
    angle = math.pi * share
    return 0.5 * (1.0 - math.cos(angle)), 0.5 * math.pi * math.sin(angle)
