"""Policies by name, behind one interface."""

from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from policy_runner.inputs import Inputs
from policy_runner.trot import TROTS, ScriptedTrot

Floats = NDArray[np.float64]


class Policy(Protocol):
    """
    Turns measurements and a velocity command into joint position targets.

    rate: Hz at which step() wants to be called. ramp: s after reset() during which it moves from
    the present pose to standing and takes no commands.
    """

    rate: float
    ramp: float

    def reset(self) -> None:
        """Forget the past, before activation."""

    def step(
        self, time: float, command: Floats, inputs: Inputs, base_velocity: Floats | None
    ) -> Floats:
        """Joint targets, rad [12]; command: vx, vy, yaw rate [3]; velocity None if not known."""


class TrotPolicy:
    """The scripted trot as a policy."""

    rate = 200.0

    def __init__(self, trot: ScriptedTrot) -> None:
        self._trot = trot
        self.ramp = trot.config.ramp

    def reset(self) -> None:
        """Forget the past."""
        self._trot.reset()

    def step(
        self, time: float, command: Floats, inputs: Inputs, base_velocity: Floats | None
    ) -> Floats:
        """Joint targets, rad [12]."""
        return self._trot.step(
            time, command, inputs.position, inputs.gravity, inputs.spin, base_velocity
        )


POLICIES: Final = tuple(TROTS)
"""Names of the policies there are."""


def load_policy(name: str) -> Policy:
    """Make the policy of a name; KeyError, with those there are, if there is none."""
    if name not in POLICIES:
        raise KeyError(f'no policy {name!r}; there are {", ".join(POLICIES)}')
    return TrotPolicy(ScriptedTrot(TROTS[name]))
