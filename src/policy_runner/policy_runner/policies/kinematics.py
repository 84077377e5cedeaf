"""Leg kinematics of ANYmal C: three joints a leg, feet in the base's frame."""

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.anymal import (
    FOOT_IN_SHANK,
    FRONT,
    HIP_CENTRE,
    HIP_IN_BASE,
    HIP_MASS,
    LEFT,
    SHANK_CENTRE,
    SHANK_IN_THIGH,
    SHANK_MASS,
    THIGH_CENTRE,
    THIGH_IN_HIP,
    THIGH_MASS,
)
from wattwalk_core.physics import GRAVITY

Floats = NDArray[np.float64]

_HIP: Final = np.column_stack([HIP_IN_BASE[0] * FRONT, HIP_IN_BASE[1] * LEFT, np.zeros(4)])
_AHEAD: Final = THIGH_IN_HIP[0] * FRONT
_ASIDE: Final = (THIGH_IN_HIP[1] + SHANK_IN_THIGH[1] + FOOT_IN_SHANK[1]) * LEFT
_THIGH: Final = -SHANK_IN_THIGH[2]
_SHANK: Final = float(np.hypot(FOOT_IN_SHANK[0], FOOT_IN_SHANK[2]))
_BEND: Final = -FRONT * float(np.arctan2(FOOT_IN_SHANK[0], -FOOT_IN_SHANK[2]))
_REACH: Final = (abs(_THIGH - _SHANK) + 0.02, _THIGH + _SHANK - 0.005)
_MOMENT_ASIDE: Final = (
    HIP_MASS * HIP_CENTRE[1] * LEFT
    + THIGH_MASS * ((THIGH_IN_HIP[1] + THIGH_CENTRE[1]) * LEFT)
    + SHANK_MASS * ((THIGH_IN_HIP[1] + SHANK_IN_THIGH[1] + SHANK_CENTRE[1]) * LEFT)
)


@dataclass(frozen=True)
class LegState:
    """Feet and their Jacobians at given joint angles, in the base's frame."""

    angles: Floats = field(repr=False)  # rad [..., 4, 3]
    feet: Floats  # m [..., 4, 3], centres of the foot spheres
    jacobian: Floats = field(repr=False)  # m/rad [..., 4, 3, 3]


def clipped(values: Floats, low: Floats | float, high: Floats | float) -> Floats:
    """Return values within low..high; `np.clip` takes several times as long for a few numbers."""
    return np.asarray(np.minimum(np.maximum(values, low), high))


def forward(position: Floats) -> LegState:
    """Return feet and Jacobians at joint angles, rad [..., 12]."""
    angles = np.reshape(position, (*np.shape(position)[:-1], 4, 3))
    haa, hfe, kfe = angles[..., 0], angles[..., 1], angles[..., 2]
    shank_angle = hfe + kfe + _BEND
    knee_x, knee_z = -_THIGH * np.sin(hfe), -_THIGH * np.cos(hfe)
    shank_x, shank_z = -_SHANK * np.sin(shank_angle), -_SHANK * np.cos(shank_angle)
    x, z = knee_x + shank_x, knee_z + shank_z
    c, s = np.cos(haa), np.sin(haa)
    feet = np.empty(angles.shape)
    feet[..., 0] = _AHEAD + x
    feet[..., 1] = _ASIDE * c - z * s
    feet[..., 2] = _ASIDE * s + z * c
    jacobian = np.zeros((*angles.shape, 3))
    jacobian[..., 1, 0] = -feet[..., 2]
    jacobian[..., 2, 0] = feet[..., 1]
    jacobian[..., 0, 1] = z
    jacobian[..., 1, 1] = x * s
    jacobian[..., 2, 1] = -x * c
    jacobian[..., 0, 2] = shank_z
    jacobian[..., 1, 2] = shank_x * s
    jacobian[..., 2, 2] = -shank_x * c
    feet += _HIP
    return LegState(angles=angles, feet=feet, jacobian=jacobian)


def inverse(feet: Floats) -> Floats:
    """
    Return joint angles, rad [..., 4, 3], for feet at places in the base's frame, m [..., 4, 3].

    Knees point inwards as in DEFAULT_POSE. Places out of reach give the nearest straight leg.
    """
    place = feet - _HIP
    x, y, z = place[..., 0], place[..., 1], place[..., 2]
    side = np.hypot(y, z)
    drop = -np.sqrt(np.maximum(side**2 - _ASIDE**2, 1e-4))
    haa = np.arctan2(z, y) - np.arctan2(drop, _ASIDE)
    haa = (haa + np.pi) % (2 * np.pi) - np.pi
    x = x - _AHEAD
    reach = np.clip(np.hypot(x, drop), *_REACH)
    fold = np.arccos((reach**2 - _THIGH**2 - _SHANK**2) / (2 * _THIGH * _SHANK))
    knee = -FRONT * fold
    hfe = np.arctan2(-x, -drop) - np.arctan2(_SHANK * np.sin(knee), _THIGH + _SHANK * np.cos(knee))
    return np.stack([haa, hfe, knee - _BEND], axis=-1)


def leg_weight_torque(angles: Floats, gravity: Floats) -> Floats:
    """
    Return joint torques that compensate the legs' own weight, N·m [..., 4, 3].

    angles: rad [..., 4, 3]. gravity: its direction in the base's frame, unit vector [..., 3].
    """
    haa, hfe, kfe = angles[..., 0], angles[..., 1], angles[..., 2]
    c, s = np.cos(haa), np.sin(haa)
    pull_x, y, z = (GRAVITY * gravity[..., axis, None] for axis in range(3))
    pull_y, pull_z = c * y + s * z, c * z - s * y
    centre_x, centre_z = SHANK_CENTRE[0] * FRONT, SHANK_CENTRE[2]
    knee_x, knee_z = -_THIGH * np.sin(hfe), -_THIGH * np.cos(hfe)
    share = -THIGH_CENTRE[2] / _THIGH
    thigh_x, thigh_z = share * knee_x, share * knee_z
    cs, ss = np.cos(hfe + kfe), np.sin(hfe + kfe)
    shank_x, shank_z = centre_x * cs + centre_z * ss, centre_z * cs - centre_x * ss
    moment_x = THIGH_MASS * thigh_x + SHANK_MASS * (knee_x + shank_x)
    moment_z = THIGH_MASS * thigh_z + SHANK_MASS * (knee_z + shank_z)
    return np.stack(
        [
            moment_z * pull_y - _MOMENT_ASIDE * pull_z,
            moment_x * pull_z - moment_z * pull_x,
            SHANK_MASS * (shank_x * pull_z - shank_z * pull_x),
        ],
        axis=-1,
    )
