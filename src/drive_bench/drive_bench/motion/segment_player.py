"""Segment player: execution of a motion for one drive, with feedback of its state."""

import math

from drive_bench.motion.file import MotionFile
from drive_bench.motion.plan import Plan
from drive_bench.motion.segment_path import Mounting, Ramps, Target
from drive_bench.motion.segments import Segment


class SegmentPlayer:
    """
    Player of a motion for a joint that starts at a position, rad.

    After a segment in velocity or torque mode the rest is planned again from the measured
    position. A segment with until_warmer ends once the winding is that much warmer than at the
    start.
    """

    def __init__(self, motion: MotionFile, start: float, mounting: Mounting, ramps: Ramps) -> None:
        self.plan = Plan(motion, start, mounting, ramps)
        self.motion = motion
        self.elapsed = 0.0
        self._place = 0
        self._initial: float | None = None
        self._warmed: int | None = None

    @property
    def left(self) -> float:
        """Remaining time, s; an upper bound for segments with until_warmer."""
        return max(self.plan.seconds - self.elapsed, 0.0)

    @property
    def place(self) -> int:
        """Index of the segment; the return at the end counts as one."""
        return self._place

    @property
    def segment(self) -> Segment:
        """The present segment."""
        return self.plan.paths[self._place].segment

    @property
    def needs_temperature(self) -> bool:
        """True if the end of the segment depends on the winding temperature."""
        return bool(self.segment.until_warmer) and self._warmed != self._place

    def step(self, seconds: float, position: float, temperature: float = math.nan) -> Target:
        """Advance by some seconds and return the target; measured: rad and °C."""
        self.elapsed += seconds
        self._end_when_warm(temperature)
        place = self.plan.place(self.elapsed)
        if place != self._place:
            if self.segment.free:
                place = self._place + 1
                self.plan.begin_anew(place, position)
            self._place = place
        return self.plan.at(self.elapsed)

    def _end_when_warm(self, temperature: float) -> None:
        if math.isnan(temperature):
            return
        self._initial = temperature if self._initial is None else self._initial
        wanted, hottest = self.segment.until_warmer, self.segment.hottest
        if not self.needs_temperature:
            return
        if temperature - self._initial >= wanted or temperature >= hottest:
            leap = self.plan.skip(self.elapsed)
            self.elapsed += leap
            if leap:
                self._warmed = self._place
