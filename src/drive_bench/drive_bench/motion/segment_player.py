"""A motion as it is played to one drive, with what depends on where the drive has got to."""

import math

from drive_bench.motion.file import MotionFile
from drive_bench.motion.plan import Plan
from drive_bench.motion.segment_path import Mounting, Ramps, Target
from drive_bench.motion.segments import Segment


class Player:
    """
    Plays a motion to a joint that starts at a position, rad.

    After a segment in velocity or torque mode the rest is planned from where the joint then is. A
    segment with until_warmer ends once the winding is that much warmer than at the start.
    """

    def __init__(self, motion: MotionFile, start: float, mounting: Mounting, ramps: Ramps) -> None:
        self.plan = Plan(motion, start, mounting, ramps)
        self.motion = motion
        self.elapsed = 0.0
        self._place = 0
        self._cold: float | None = None
        self._warm: int | None = None

    @property
    def left(self) -> float:
        """Time to the end, s; less where a winding gets warm soon."""
        return max(self.plan.seconds - self.elapsed, 0.0)

    @property
    def place(self) -> int:
        """Index of the segment, that of the way back included."""
        return self._place

    @property
    def segment(self) -> Segment:
        """The segment that is played."""
        return self.plan.paths[self._place].segment

    @property
    def heeds(self) -> bool:
        """Whether the segment goes on for as long as the winding is not warm yet."""
        return bool(self.segment.until_warmer) and self._warm != self._place

    def step(self, seconds: float, position: float, temperature: float = math.nan) -> Target:
        """The target some seconds on; position, rad, and temperature, °C, are measured."""
        self.elapsed += seconds
        self._heed(temperature)
        place = self.plan.place(self.elapsed)
        if place != self._place:
            if self.segment.free:
                place = self._place + 1
                self.plan.begin_anew(place, position)
            self._place = place
        return self.plan.at(self.elapsed)

    def _heed(self, temperature: float) -> None:
        if math.isnan(temperature):
            return
        self._cold = temperature if self._cold is None else self._cold
        wanted, hottest = self.segment.until_warmer, self.segment.hottest
        if not self.heeds:
            return
        if temperature - self._cold >= wanted or temperature >= hottest:
            leap = self.plan.skip(self.elapsed)
            self.elapsed += leap
            if leap:
                self._warm = self._place
