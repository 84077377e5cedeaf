"""Joint torques of stance forces that support, level and steer the body."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.anymal import FOOT_RADIUS, ROBOT_MASS
from wattwalk_core.physics import GRAVITY

from policy_runner.policies.kinematics import LegState

Floats = NDArray[np.float64]


def stance_torque(
    gains: Mapping[str, Floats],
    legs: LegState,
    load: Floats,
    *,
    height: Floats,
    gravity: Floats,
    spin: Floats,
    velocity_error: Floats,
) -> Floats:
    """
    Return joint torques of the stance legs of N robots, N·m [N, 4, 3].

    Normal forces are the least-squares ones that give weight, height and levelling together;
    horizontal ones are in proportion to them. gains: those of `Feedback` by name, [N] each. load:
    share of the weight that each foot may bear [N, 4]. height: commanded, m [N]. gravity: unit
    vector in the base's frame [N, 3]. spin: rad/s [N, 3]. velocity_error: commanded minus measured
    vx, vy, yaw rate [N, 3].
    """
    from policy_runner.policies.leg_steps import stance_steps  # compiled: numba is slow to import

    rows = [gains[name] for name in ('height', 'tilt', 'tilt_rate', 'velocity', 'yaw')]
    torque = np.empty(legs.feet.shape)
    stance_steps(
        np.array([*rows, height], np.float64),
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
