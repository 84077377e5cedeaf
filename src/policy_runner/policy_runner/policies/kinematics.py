"""Leg kinematics of ANYmal C: three joints a leg, feet in the base's frame, no model needed."""

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

LEGS: Final = ('LF', 'RF', 'LH', 'RH')
JOINT_NAMES: Final = tuple(f'{leg}_{joint}' for leg in LEGS for joint in ('HAA', 'HFE', 'KFE'))
FRONT: Final = np.array([1.0, 1.0, -1.0, -1.0])
LEFT: Final = np.array([1.0, -1.0, 1.0, -1.0])
DEFAULT_POSE: Final = np.outer(FRONT, [0.0, 0.4, -0.8]).ravel() + 0.0
"""Joint angles of standing, rad [12]."""
LIMITS: Final = np.array(
    [((-0.72, 0.49) if s > 0 else (-0.49, 0.72), (-9.42, 9.42), (-9.42, 9.42)) for s in LEFT]
).reshape(12, 2)
"""Lowest and highest joint angle, rad [12, 2]."""
FOOT_RADIUS: Final = 0.03  # m
GRAVITY: Final = 9.81  # m/s²

_HIP: Final = np.column_stack([0.2999 * FRONT, 0.104 * LEFT, np.zeros(4)])
_AHEAD: Final = 0.0599 * FRONT
_ASIDE: Final = (0.0838 + 0.1003 + 0.0131) * LEFT
_THIGH: Final = 0.285
_SHANK: Final = float(np.hypot(0.0880, 0.3155))
_BEND: Final = -FRONT * float(np.arctan2(0.0880, 0.3155))
_REACH: Final = (abs(_THIGH - _SHANK) + 0.02, _THIGH + _SHANK - 0.005)
_HIP_MASS, _THIGH_MASS, _SHANK_MASS = 2.781, 3.071, 0.5884
_THIGH_ASIDE: Final = (0.0838 + 0.0308) * LEFT
_SHANK_ASIDE: Final = (0.0838 + 0.1003 + 0.0055) * LEFT
_SHANK_CENTRE: Final = (0.0613 * FRONT, -0.0807)


@dataclass(frozen=True)
class LegState:
    """Feet and their Jacobians at given joint angles, in the base's frame."""

    angles: Floats = field(repr=False)  # rad [4, 3]
    feet: Floats  # m [4, 3], centres of the foot spheres
    jacobian: Floats = field(repr=False)  # m/rad [4, 3, 3]


def forward(position: Floats) -> LegState:
    """Feet and Jacobians of joint angles, rad [12]."""
    angles = np.reshape(position, (4, 3))
    haa, hfe, kfe = angles.T
    shank_angle = hfe + kfe + _BEND
    knee_x, knee_z = -_THIGH * np.sin(hfe), -_THIGH * np.cos(hfe)
    shank_x, shank_z = -_SHANK * np.sin(shank_angle), -_SHANK * np.cos(shank_angle)
    x, z = knee_x + shank_x, knee_z + shank_z
    c, s = np.cos(haa), np.sin(haa)
    feet = np.empty((4, 3))
    feet[:, 0] = _AHEAD + x
    feet[:, 1] = _ASIDE * c - z * s
    feet[:, 2] = _ASIDE * s + z * c
    jacobian = np.zeros((4, 3, 3))
    jacobian[:, 1, 0] = -feet[:, 2]
    jacobian[:, 2, 0] = feet[:, 1]
    jacobian[:, 0, 1] = z
    jacobian[:, 1, 1] = x * s
    jacobian[:, 2, 1] = -x * c
    jacobian[:, 0, 2] = shank_z
    jacobian[:, 1, 2] = shank_x * s
    jacobian[:, 2, 2] = -shank_x * c
    feet += _HIP
    return LegState(angles=angles, feet=feet, jacobian=jacobian)


def inverse(feet: Floats) -> Floats:
    """
    Joint angles, rad [4, 3], that put the feet at places in the base's frame, m [4, 3].

    Knees point inwards as in DEFAULT_POSE. Places out of reach give the nearest straight leg.
    """
    x, y, z = (feet - _HIP).T
    side = np.hypot(y, z)
    drop = -np.sqrt(np.maximum(side**2 - _ASIDE**2, 1e-4))
    haa = np.arctan2(z, y) - np.arctan2(drop, _ASIDE)
    haa = (haa + np.pi) % (2 * np.pi) - np.pi
    x = x - _AHEAD
    reach = np.clip(np.hypot(x, drop), *_REACH)
    fold = np.arccos((reach**2 - _THIGH**2 - _SHANK**2) / (2 * _THIGH * _SHANK))
    knee = -FRONT * fold
    hfe = np.arctan2(-x, -drop) - np.arctan2(_SHANK * np.sin(knee), _THIGH + _SHANK * np.cos(knee))
    return np.column_stack([haa, hfe, knee - _BEND])


def leg_weight_torque(angles: Floats, gravity: Floats) -> Floats:
    """
    Joint torques that carry the legs' own weight, N·m [4, 3].

    angles: rad [4, 3]. gravity: direction of gravity in the base's frame, unit vector [3].
    """
    haa, hfe, kfe = angles.T
    c, s = np.cos(haa), np.sin(haa)
    pull = GRAVITY * gravity
    pull_x, pull_y, pull_z = pull[0], c * pull[1] + s * pull[2], c * pull[2] - s * pull[1]
    centre_x, centre_z = _SHANK_CENTRE
    knee_x, knee_z = -_THIGH * np.sin(hfe), -_THIGH * np.cos(hfe)
    thigh_x, thigh_z = 0.2457 / _THIGH * knee_x, 0.2457 / _THIGH * knee_z
    cs, ss = np.cos(hfe + kfe), np.sin(hfe + kfe)
    shank_x, shank_z = centre_x * cs + centre_z * ss, centre_z * cs - centre_x * ss
    moment_x = _THIGH_MASS * thigh_x + _SHANK_MASS * (knee_x + shank_x)
    moment_z = _THIGH_MASS * thigh_z + _SHANK_MASS * (knee_z + shank_z)
    moment_y = _HIP_MASS * 0.0174 * LEFT + _THIGH_MASS * _THIGH_ASIDE + _SHANK_MASS * _SHANK_ASIDE
    return np.column_stack(
        [
            moment_z * pull_y - moment_y * pull_z,
            moment_x * pull_z - moment_z * pull_x,
            _SHANK_MASS * (shank_x * pull_z - shank_z * pull_x),
        ]
    )
