"""Leg kinematics of ANYmal C: three joints a leg, feet in the base's frame."""

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from wattwalk_core.anymal import FRONT, GRAVITY, HIP_IN_BASE, LEFT
from wattwalk_core.arrays import Floats

from wattwalk_core import anymal

_AHEAD, _HIP_ASIDE, _ = anymal.THIGH_IN_HIP
_, _THIGH_ASIDE, _KNEE_DOWN = anymal.SHANK_IN_THIGH
_FOOT_AHEAD, _FOOT_ASIDE, _FOOT_DOWN = anymal.FOOT_IN_SHANK
_THIGH: Final = -_KNEE_DOWN
_SHANK: Final = float(np.hypot(_FOOT_AHEAD, _FOOT_DOWN))
_BEND: Final = -FRONT * float(np.arctan2(_FOOT_AHEAD, -_FOOT_DOWN))
_MOMENT_ASIDE: Final = (
    anymal.HIP_MASS * anymal.HIP_CENTRE[1] * LEFT
    + anymal.THIGH_MASS * ((_HIP_ASIDE + anymal.THIGH_CENTRE[1]) * LEFT)
    + anymal.SHANK_MASS * ((_HIP_ASIDE + _THIGH_ASIDE + anymal.SHANK_CENTRE[1]) * LEFT)
)
_HIP: Final = np.vstack([HIP_IN_BASE[0] * FRONT, HIP_IN_BASE[1] * LEFT, np.zeros(4)])
_ASIDE: Final = (_HIP_ASIDE + _THIGH_ASIDE + _FOOT_ASIDE) * LEFT
_LEGS: Final = np.vstack([_HIP, _AHEAD * FRONT, _ASIDE, _BEND, FRONT])
_LENGTHS: Final = np.array([_THIGH, _SHANK, abs(_THIGH - _SHANK) + 0.02, _THIGH + _SHANK - 0.005])
_WEIGHTS: Final = np.vstack([_MOMENT_ASIDE, anymal.SHANK_CENTRE[0] * FRONT])
_THIGH_SHARE: Final = -anymal.THIGH_CENTRE[2] / _THIGH
_MASSES: Final = np.array(
    [anymal.THIGH_MASS, anymal.SHANK_MASS, _THIGH, _THIGH_SHARE, anymal.SHANK_CENTRE[2]]
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
    from policy_runner.policies.leg_steps import forward_steps  # compiled: numba is slow to import

    angles = np.reshape(position, (*np.shape(position)[:-1], 4, 3))
    flat = np.array(angles, np.float64, order='C').reshape(-1, 4, 3)
    feet, jacobian = np.empty(flat.shape), np.empty((*flat.shape, 3))
    forward_steps(_LEGS, _LENGTHS, flat, feet, jacobian)
    shape = angles.shape
    return LegState(angles, feet.reshape(shape), jacobian.reshape((*shape, 3)))


def inverse(feet: Floats) -> Floats:
    """Return joint angles, rad [..., 4, 3], for feet at places in the base's frame, m [..., 4, 3].

    Knees point inwards as in DEFAULT_POSE. Places out of reach give the nearest straight leg.
    """
    from policy_runner.policies.leg_steps import inverse_steps  # compiled: numba is slow to import

    places = np.ascontiguousarray(feet, np.float64).reshape(-1, 4, 3)
    angles = np.empty(places.shape)
    inverse_steps(_LEGS, _LENGTHS, places, angles)
    return angles.reshape(np.shape(feet))


def leg_weight_torque(angles: Floats, gravity: Floats) -> Floats:
    """Return joint torques that compensate the legs' own weight, N·m [..., 4, 3].

    angles: rad [..., 4, 3]. gravity: its direction in the base's frame, unit vector [..., 3].
    """
    from policy_runner.policies.leg_steps import weight_steps  # compiled: numba is slow to import

    flat = np.ascontiguousarray(angles, np.float64).reshape(-1, 4, 3)
    pull = np.broadcast_to(GRAVITY * np.asarray(gravity), (*angles.shape[:-2], 3)).reshape(-1, 3)
    torque = np.empty(flat.shape)
    weight_steps(_WEIGHTS, _MASSES, flat, np.array(pull, order='C'), torque)
    return torque.reshape(angles.shape)
