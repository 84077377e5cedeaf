"""Joint torques of stance forces that support, level and steer the body."""

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.anymal import FOOT_RADIUS, ROBOT_MASS
from wattwalk_core.physics import GRAVITY

from policy_runner.policies.kinematics import LegState, clipped

Floats = NDArray[np.float64]

_FOOT_FORCE_LIMIT: Final = 500.0  # N, normal, of one foot
_PUSH_LIMIT: Final = 120.0  # N, horizontal, of all feet


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
    feet = legs.feet
    x, y = feet[..., 0], feet[..., 1]
    total = load.sum(axis=1)
    bearing = total >= 0.1
    reached = FOOT_RADIUS - (load * feet[..., 2]).sum(axis=1) / np.maximum(total, 0.1)
    lift = gains['height'] * clipped(height - reached, -0.05, 0.05)
    tilt, rate = gains['tilt'], gains['tilt_rate']
    wrench = np.stack(
        [
            ROBOT_MASS * GRAVITY + lift,
            tilt * gravity[:, 1] - rate * spin[:, 0],
            -tilt * gravity[:, 0] - rate * spin[:, 1],
        ],
        axis=1,
    )
    arms = np.stack([np.ones_like(y), y, -x], axis=1)
    loaded = arms * load[:, None]
    gram = loaded @ arms.transpose(0, 2, 1) + 1e-3 * np.eye(3)
    normal = (loaded.transpose(0, 2, 1) @ np.linalg.solve(gram, wrench[..., None]))[..., 0]
    normal = clipped(normal, 0.0, _FOOT_FORCE_LIMIT) * bearing[:, None]

    part = normal / np.maximum(normal.sum(axis=1, keepdims=True), 50.0)
    push = clipped(gains['velocity'][:, None] * velocity_error[:, :2], -_PUSH_LIMIT, _PUSH_LIMIT)
    inertia = (part * (x * x + y * y)).sum(axis=1) + 1e-3
    twist = (gains['yaw'] * velocity_error[:, 2] / inertia)[:, None]
    force = np.empty(feet.shape)
    force[..., 0] = part * (push[:, :1] - twist * y) - gravity[:, :1] * normal
    force[..., 1] = part * (push[:, 1:] + twist * x) - gravity[:, 1:2] * normal
    force[..., 2] = -gravity[:, 2:] * normal
    return -(force[..., None, :] @ legs.jacobian)[..., 0, :]
