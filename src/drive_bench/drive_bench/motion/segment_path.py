"""Path of one joint through one segment of a motion.

The mounting determines how a load acts. With a pendulum or a hung leg
the load is what gravity gives: a held torque is the angle at which it pulls as much, and at speed
the load swings as the pendulum goes round. With a locked joint the drive itself pushes.
"""

import math
from dataclasses import dataclass
from typing import Final

from wattwalk_core.errors import InputError

from drive_bench.motion.segments import Segment


@dataclass(frozen=True)
class Mounting:
    """Load that a drive turns.

    pendulum: torque with which gravity pulls at a right angle, N·m; 0 for none. hanging: angle at
    which it hangs, rad. locked: the joint cannot turn. InputError for impossible values.
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
        """Return the angle from hanging, rad, at which gravity pulls with a torque, N·m."""
        if self.locked or not self.pendulum:
            return 0.0
        return math.asin(max(-1.0, min(1.0, torque / self.pendulum)))

    def middle(self, position: float) -> float:
        """Return the angle without load that is nearest to a position, rad."""
        if not self.pendulum:
            return position
        turn = 2.0 * math.pi
        return self.hanging + turn * round((position - self.hanging) / turn)


@dataclass(frozen=True)
class Ramps:
    """Limits of the transitions from one target to the next.

    way: largest speed on the way to where a segment begins, rad/s. acceleration: largest in
    transitions and speed changes, rad/s². torque: N·m/s at which a locked joint is loaded.
    """

    way: float = 1.0
    acceleration: float = 40.0
    torque: float = 40.0

    def way_seconds(self, distance: float) -> float:
        """Return the shortest duration, s, of a half cosine over a distance, rad."""
        d = abs(distance)
        return max(0.5 * math.pi * d / self.way, math.pi * math.sqrt(0.5 * d / self.acceleration))


JUMPS: Final = Ramps(math.inf, math.inf, math.inf)  # no limits: targets jump, for simulated drives


@dataclass(frozen=True)
class Target:
    """Command of a drive: position, rad, with velocity, rad/s, and effort, N·m, as feed-forward.

    In mode velocity or torque only that is commanded; position is the expected one.
    """

    position: float
    velocity: float = 0.0
    effort: float = 0.0
    mode: str = 'position'


class SegmentPath:
    """Targets of one segment and of the transition to its beginning.

    Time counts from the start of the transition, which adds to the segment's seconds.
    """

    def __init__(self, segment: Segment, start: float, mounting: Mounting, ramps: Ramps) -> None:
        self.segment = segment
        self._start, self._ramps, self._locked = start, ramps, mounting.locked
        middle = start if segment.free else mounting.middle(start)
        first = segment.high if segment.alternates else segment.held
        self._goal = start if segment.turns or segment.free else middle + mounting.angle(first)
        self._low = middle + mounting.angle(segment.low)
        self._way = self._goal - start
        self.way_seconds = ramps.way_seconds(self._way)
        if mounting.locked:
            self.way_seconds = abs(first) / ramps.torque
        self.seconds = self.way_seconds + segment.seconds
        self.turn_seconds = abs(segment.speed) / ramps.acceleration if segment.turns else 0.0
        self.change_seconds = 0.0
        if segment.alternates and not mounting.locked:
            self.change_seconds = ramps.way_seconds(self._low - self._goal)

    def skip(self, time: float) -> float:
        """Return the time, s, by which the segment can be shortened without a jump."""
        segment, since = self.segment, time - self.way_seconds
        if not segment.frequency or math.isinf(self._ramps.acceleration):
            return max(self.seconds - time, 0.0)
        turns = math.floor(segment.frequency * (segment.seconds - since)) - 1
        return max(turns, 0) / segment.frequency if since > 1.0 / segment.frequency else 0.0

    @property
    def end(self) -> float:
        """Last target, rad."""
        return self.at(self.seconds).position

    @property
    def extent(self) -> tuple[float, float]:
        """Lowest and highest target, rad."""
        ends = [self._start, self._goal, self.end]
        if self.segment.alternates:
            ends.append(self._low)
        return min(ends), max(ends)

    def at(self, time: float) -> Target:
        """Return the target at a time, s after the start of the transition."""
        segment = self.segment
        if segment.turns:
            return self._turning(time)
        if time < self.way_seconds:
            return self._on_the_way(time)
        if segment.alternates:
            return self._alternating(time - self.way_seconds)
        return Target(self._goal, effort=segment.held if self._locked else 0.0)

    def _on_the_way(self, time: float) -> Target:
        share = time / self.way_seconds
        if self._locked:
            first = self.segment.high if self.segment.alternates else self.segment.held
            return Target(self._start, effort=share * first)
        place, speed = half_cosine(share)
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
        place, speed = half_cosine(within / self.change_seconds)
        return Target(back + (there - back) * place, (there - back) * speed / self.change_seconds)


def half_cosine(share: float) -> tuple[float, float]:
    """Return position 0..1 and its derivative of a half cosine at a share 0..1 of its duration."""
    angle = math.pi * share
    return 0.5 * (1.0 - math.cos(angle)), 0.5 * math.pi * math.sin(angle)
