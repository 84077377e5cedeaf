"""Path of one joint through a motion, and its check against the limits."""

from bisect import bisect_right
from dataclasses import replace

from wattwalk_core.errors import InputError

from drive_bench.motion.file import MotionFile
from drive_bench.motion.joint_limits import ROUNDING, JointLimits
from drive_bench.motion.segment_path import JUMPS, Mounting, Ramps, SegmentPath, Target
from drive_bench.motion.segments import Segment
from drive_bench.motion.wave_path import WavePath


class Plan:
    """
    Targets of a whole motion for a joint that starts at a position, rad.

    With ramps, a swing fades in and out within a period, and at the end the joint returns to
    where it carries no load.
    """

    def __init__(
        self, motion: MotionFile, start: float, mounting: Mounting, ramps: Ramps = JUMPS
    ) -> None:
        self._mounting, self._ramps, self._segments = mounting, ramps, motion.segments
        self.paths: list[SegmentPath] = []
        self._begins: list[float] = []
        self._count = len(motion.segments)
        self.begin_anew(0, start)

    def begin_anew(self, first: int, start: float) -> None:
        """Plan the segments from index first on again, from a position, rad."""
        del self.paths[first:], self._begins[first:]
        position, free = start, False
        for segment in self._segments[first:]:
            path = path_of(segment, position, self._mounting, self._ramps)
            self._append(path)
            position, free = path.end, segment.free
        back = SegmentPath(Segment('rest', 0.0), position, self._mounting, self._ramps)
        if back.seconds > 0.0 or free or not self.paths[first:]:
            self._append(back)
        self.seconds = self._begins[-1] + self.paths[-1].seconds

    def _append(self, path: SegmentPath) -> None:
        ends = self._begins[-1] + self.paths[-1].seconds if self.paths else 0.0
        self._begins.append(ends)
        self.paths.append(path)

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
        for number, path in enumerate(self.paths[: self._count], 1):
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
    kind = WavePath if segment.shape and not segment.swings else SegmentPath
    return kind(_settled(segment), start, mounting, ramps)


def _settled(segment: Segment) -> Segment:
    """Return a segment that turns at speed 0 as one that holds the load."""
    if segment.mode == 'velocity' and not (segment.turns or segment.shape):
        return replace(segment, mode='torque', torque=segment.load, frequency=0.0)
    return segment
