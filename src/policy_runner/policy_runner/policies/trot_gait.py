"""Configuration, stance torques and gait cycle of the scripted trot."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf
from types import MappingProxyType
from typing import Annotated, Final

import numpy as np
from wattwalk_core.anymal import FOOT_RADIUS, FRONT, GRAVITY, LEFT, ROBOT_MASS
from wattwalk_core.arrays import Floats
from wattwalk_core.schema import Quantity, check_quantities

from policy_runner.policies.kinematics import LegState, clipped

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


def stance_torque(
    gains: Feedback,
    legs: LegState,
    load: Floats,
    *,
    height: float,
    gravity: Floats,
    spin: Floats,
    velocity_error: Floats,
) -> Floats:
    """Return joint torques of the stance legs, N·m [4, 3].

    Normal forces are the least-squares ones that give weight, height and levelling together;
    horizontal ones are in proportion to them. load: share of the weight that each foot may bear
    [4]. height: commanded, m. gravity: unit vector in the base's frame [3]. spin: rad/s [3].
    velocity_error: commanded minus measured vx, vy, yaw rate [3].
    """
    from policy_runner.policies.leg_steps import stance_steps  # compiled: numba is slow to import

    g = gains
    torque = np.empty((4, 3))
    stance_steps(
        np.array([g.height, g.tilt, g.tilt_rate, g.velocity, g.yaw, height]),
        ROBOT_MASS * GRAVITY,
        FOOT_RADIUS,
        legs.feet,
        legs.jacobian,
        np.array(load, np.float64),
        np.array(gravity, np.float64),
        np.array(spin, np.float64),
        np.array(velocity_error, np.float64),
        torque,
    )
    return torque


class GaitCycle:
    """Gait cycle of a trot: walking or standing, and the phase of each foot."""

    def __init__(self) -> None:
        self.walking = False
        self.stride = 0.0
        """Phase of the first pair of legs, 0..1; the second pair is half a stride ahead."""
        self.phase = np.zeros(4)  # share of the stride since touchdown
        self.swinging = np.zeros(4, bool)
        self.load = np.ones(4)  # share of the weight that a foot may bear, 0..1
        self._settled_time = 0.0
        self._duty = 0.5

    @property
    def swing_progress(self) -> Floats:
        """Completed share of the swing [4], of swinging feet."""
        return (self.phase - self._duty) / (1.0 - self._duty)

    def advance(
        self, dt: float, frequency: float, duty: float, *, requested: bool, settled: bool
    ) -> None:
        """Advance by dt s at a stride frequency, Hz, and a duty.

        requested: a command or a disturbance calls for steps. settled: body and feet are where
        they should be, so that standing is safe. Walking ends with all feet down, after half a
        settled stride.
        """
        self._duty = duty
        if self.walking:
            before, self.stride = self.stride, (self.stride + frequency * dt) % 1.0
            quiet = settled and not requested
            self._settled_time = self._settled_time + dt if quiet else 0.0
            touchdown = self.stride % 0.5 < before % 0.5
            self.walking = not (touchdown and self._settled_time > 0.5 / frequency)
        elif requested:
            self.walking, self.stride, self._settled_time = True, 0.0, 0.0
        load: Floats = np.ones(4)
        self.phase, self.swinging = np.zeros(4), np.zeros(4, bool)
        if self.walking:
            self.phase = (self.stride + _OFFSETS) % 1.0
            self.swinging = self.phase >= duty
            load = clipped(np.minimum(self.phase, duty - self.phase) / _SHIFT_WEIGHT, 0.0, 1.0)
        self.load = self.load + min(1.0, dt / 0.015) * (load - self.load)
        self.load[self.swinging] = 0.0
