"""Change of policy on a robot that stands or walks."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from policy_runner.policies.by_name import Policy
from policy_runner.policies.inputs import Inputs

Floats = NDArray[np.float64]

SETTLE: Final = 2.5  # s to brake under the old policy from 1.5 m/s at 1 m/s², and to stand
FADE: Final = 0.4  # s to go over from the targets of one to those of the other


class Handover:
    """
    Handover by a zero command until the robot stands, then a fade between the targets.

    It begins at time `now`, s; until it is done no commands are taken.
    """

    def __init__(self, old: Policy, new: Policy, now: float) -> None:
        self.new = new
        self._old = old
        self._began = now
        self._taken_over: float | None = None
        self._waiting = 0.0

    def done(self, now: float) -> bool:
        """Return True once the new policy alone is in command."""
        taken = self._taken_over
        return taken is not None and now - taken >= max(FADE, self._waiting)

    def step(self, now: float, inputs: Inputs, velocity: Floats | None) -> Floats:
        """Return joint targets, rad [12]."""
        still = np.zeros(3)
        if self._taken_over is None and now - self._began >= SETTLE:
            self._taken_over = now
            self._waiting = self.new.take_over()
        if self._taken_over is None:
            return self._old.step(now, still, inputs, velocity)
        share = (now - self._taken_over) / FADE
        targets = self.new.step(now, still, inputs, velocity)
        if share >= 1.0:
            return targets
        return (1.0 - share) * self._old.step(now, still, inputs, velocity) + share * targets
