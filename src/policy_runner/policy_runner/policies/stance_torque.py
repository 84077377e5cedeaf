"""Joint torques of stance forces that support, level and steer the body."""

from typing import Final

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.anymal import FOOT_RADIUS, ROBOT_MASS
from wattwalk_core.physics import GRAVITY

from policy_runner.policies.kinematics import LegState
from policy_runner.policies.trot_gait import Feedback

Floats = NDArray[np.float64]

_FOOT_FORCE_LIMIT: Final = 500.0  # N, normal, of one foot
_PUSH_LIMIT: Final = 120.0  # N, horizontal, of all feet


def stance_torque(
    feedback: Feedback,
    legs: LegState,
    load: Floats,
    *,
    height: float,
    gravity: Floats,
    spin: Floats,
    velocity_error: Floats,
) -> Floats:
    """
    Return joint torques of the stance legs, N·m [4, 3].

    Normal forces are the least-squares ones that give weight, height and levelling together;
    horizontal ones are in proportion to them. load: share of the weight that
    each foot may bear [4].
    height: commanded, m. gravity: unit vector in the base's frame [3]. spin: rad/s [3].
    velocity_error: commanded minus measured vx, vy, yaw rate [3].
    """
    feet = legs.feet
    x, y = feet[:, 0], feet[:, 1]
    total = float(load.sum())
    if total < 0.1:
        return np.zeros((4, 3))
    reached = FOOT_RADIUS - float(load @ feet[:, 2]) / total
    lift = feedback.height * min(max(height - reached, -0.05), 0.05)
    wrench = (
        ROBOT_MASS * GRAVITY + lift,
        feedback.tilt * gravity[1] - feedback.tilt_rate * spin[0],
        -feedback.tilt * gravity[0] - feedback.tilt_rate * spin[1],
    )
    arms = np.empty((3, 4))
    arms[0], arms[1], arms[2] = 1.0, y, -x
    loaded = arms * load
    gram = loaded @ arms.T
    gram.flat[::4] += 1e-3
    normal = loaded.T @ np.linalg.solve(gram, wrench)
    normal = np.minimum(np.maximum(normal, 0.0), _FOOT_FORCE_LIMIT)

    part = normal / max(float(normal.sum()), 50.0)
    push_x = min(max(feedback.velocity * velocity_error[0], -_PUSH_LIMIT), _PUSH_LIMIT)
    push_y = min(max(feedback.velocity * velocity_error[1], -_PUSH_LIMIT), _PUSH_LIMIT)
    twist = feedback.yaw * velocity_error[2] / (float(part @ (x * x + y * y)) + 1e-3)
    force = np.empty((4, 3))
    force[:, 0] = part * (push_x - twist * y) - gravity[0] * normal
    force[:, 1] = part * (push_y + twist * x) - gravity[1] * normal
    force[:, 2] = -gravity[2] * normal
    return -(force[:, None, :] @ legs.jacobian)[:, 0, :]
