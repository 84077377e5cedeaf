"""Configuration and gait cycle of the scripted trot."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf
from types import MappingProxyType
from typing import Annotated, Final

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.anymal import FOOT_RADIUS, FRONT, LEFT
from wattwalk_core.arrays import Bools, Floats
from wattwalk_core.schema import Quantity, check_quantities

from policy_runner.policies.kinematics import clipped

_OFFSETS: Final = np.array([0.0, 0.5, 0.5, 0.0])
_SHIFT_WEIGHT: Final = 0.06


@dataclass(frozen=True)
class Feedback:
    """Feedback gains of the body's tilt, height and velocity; InputError for one out of range.

    foothold: of foot placement by the velocity error. velocity, yaw: of stance feet. yielding:
    share of the velocity error that stance feet give way to. settle: rate at which uneven feet
    return to level. trim: rate at which lasting velocity errors are removed.
    """

    foothold: Annotated[float, Quantity(0.0, 0.4, 's')] = 0.12
    velocity: Annotated[float, Quantity(0.0, inf, 'N·s/m')] = 180.0
    yaw: Annotated[float, Quantity(0.0, inf, 'N·m·s/rad')] = 80.0
    tilt: Annotated[float, Quantity(0.0, inf, 'N·m/rad')] = 600.0
    tilt_rate: Annotated[float, Quantity(0.0, inf, 'N·m·s/rad')] = 70.0
    height: Annotated[float, Quantity(0.0, inf, 'N/m')] = 3000.0
    yielding: Annotated[float, Quantity(0.0, 1.0)] = 0.25
    settle: Annotated[float, Quantity(0.0, inf, '1/s')] = 4.0
    trim: Annotated[float, Quantity(0.0, inf, '1/s')] = 0.5

    def __post_init__(self) -> None:
        check_quantities(self)


@dataclass(frozen=True)
class TrotConfig:
    """Shape of the gait and gains of the drives; InputError for a value out of range.

    frequency: of strides. duty: share of a stride that a foot is on the ground. height: base over
    ground. foot_x, foot_y: feet from the base's centre.
    max_forward, max_lateral, max_yaw: limits of commands. ramp: from the measured pose to
    standing. stiffness: position gain of the drives. damping: their velocity gain and viscous
    gear friction that targets compensate. friction: Coulomb friction that they compensate. Both
    are below the drives' own, since overcompensation makes the joints oscillate.
    """

    frequency: Annotated[float, Quantity(0.8, 3.0, 'Hz')] = 1.9
    duty: Annotated[float, Quantity(0.5, 0.85)] = 0.58
    height: Annotated[float, Quantity(0.40, 0.62, 'm')] = 0.52
    swing_height: Annotated[float, Quantity(0.01, 0.2, 'm')] = 0.07
    foot_x: Annotated[float, Quantity(0.25, 0.5, 'm')] = 0.40
    foot_y: Annotated[float, Quantity(0.12, 0.36, 'm')] = 0.28
    max_forward: Annotated[float, Quantity(0.0, 1.5, 'm/s')] = 0.8
    max_lateral: Annotated[float, Quantity(0.0, 1.0, 'm/s')] = 0.6
    max_yaw: Annotated[float, Quantity(0.0, 2.0, 'rad/s')] = 0.9
    ramp: Annotated[float, Quantity(0.1, 10.0, 's')] = 1.5
    stiffness: Annotated[float, Quantity(20.0, 400.0, 'N·m/rad')] = 80.0
    damping: Annotated[float, Quantity(0.0, 30.0, 'N·m·s/rad')] = 3.5
    friction: Annotated[float, Quantity(0.0, 10.0, 'N·m')] = 1.2
    feedback: Feedback = field(default_factory=Feedback)

    def __post_init__(self) -> None:
        check_quantities(self)

    @property
    def footholds(self) -> Floats:
        """Feet of a standing robot in the base's frame, m [4, 3]."""
        depth = np.full(4, FOOT_RADIUS - self.height)
        return np.column_stack([self.foot_x * FRONT, self.foot_y * LEFT, depth])


DEFAULT_TROT: Final = TrotConfig()
TROTS: Final[Mapping[str, TrotConfig]] = MappingProxyType(
    {
        'trot': DEFAULT_TROT,
        'trot_slow': TrotConfig(frequency=1.5, duty=0.64, height=0.50),
        'trot_high': TrotConfig(frequency=2.0, height=0.55, swing_height=0.10, foot_y=0.30),
    }
)
"""Gaits by name, which load the drives differently."""


class GaitCycle:
    """Gait cycle of N robots that trot: walking or standing, and the phase of each foot."""

    def __init__(self, count: int = 1) -> None:
        self.walking = np.zeros(count, bool)
        self.stride = np.zeros(count)
        """Phase of the first pair of legs, 0..1; the second pair is half a stride ahead."""
        self.phase = np.zeros((count, 4))  # share of the stride since touchdown
        self.swinging = np.zeros((count, 4), bool)
        self.load = np.ones((count, 4))  # share of the weight that a foot may bear, 0..1
        self._settled_time = np.zeros(count)
        self._duty = np.full(count, 0.5)

    def reset(self, ids: NDArray[np.intp]) -> None:
        """Reset the robots of these indices to standing."""
        self.walking[ids] = False
        self.stride[ids] = 0.0
        self.phase[ids] = 0.0
        self.swinging[ids] = False
        self.load[ids] = 1.0
        self._settled_time[ids] = 0.0

    @property
    def swing_progress(self) -> Floats:
        """Completed share of the swing [N, 4], of swinging feet."""
        duty = self._duty[:, None]
        return np.asarray((self.phase - duty) / (1.0 - duty))

    def advance(
        self, dt: Floats, frequency: Floats, duty: Floats, *, requested: Bools, settled: Bools
    ) -> None:
        """Advance by dt s at a stride frequency, Hz, and a duty [N].

        requested: a command or a disturbance calls for steps. settled: body and feet are where
        they should be, so that standing is safe [N]. Walking ends with all feet down, after half a
        settled stride.
        """
        self._duty = duty
        going, begins = self.walking, ~self.walking & requested
        before = self.stride
        after = (before + frequency * dt) % 1.0
        quiet = settled & ~requested
        time = np.where(quiet, self._settled_time + dt, 0.0)
        touchdown = after % 0.5 < before % 0.5
        ends = going & touchdown & (time > 0.5 / frequency)
        self.stride = np.where(going, after, np.where(begins, 0.0, before))
        self._settled_time = np.where(going, time, np.where(begins, 0.0, self._settled_time))
        self.walking = (going | begins) & ~ends
        walking = self.walking[:, None]
        self.phase = np.where(walking, (self.stride[:, None] + _OFFSETS) % 1.0, 0.0)
        self.swinging = walking & (self.phase >= duty[:, None])
        border = np.minimum(self.phase, duty[:, None] - self.phase) / _SHIFT_WEIGHT
        load = np.where(walking, clipped(border, 0.0, 1.0), 1.0)
        self.load = self.load + np.minimum(1.0, dt / 0.015)[:, None] * (load - self.load)
        self.load[self.swinging] = 0.0
