"""ANYmal C: names, standing pose, limits, gains, geometry and masses.

Geometry, masses and limits are those of the manufacturer's URDF, with every frame aligned to the
base. Vectors of the leg LF; those of the others follow by FRONT (x) and LEFT (y).
"""

from typing import Final

import numpy as np

LEGS: Final = ('LF', 'RF', 'LH', 'RH')
JOINT_TYPES: Final = ('HAA', 'HFE', 'KFE')
JOINT_NAMES: Final = tuple(f'{leg}_{joint}' for leg in LEGS for joint in JOINT_TYPES)
"""Order of the 12 joints everywhere."""
FOOT_NAMES: Final = tuple(f'{leg}_FOOT' for leg in LEGS)
FRONT: Final = np.array([1.0, 1.0, -1.0, -1.0])  # 1 for front legs, −1 for hind legs [4]
LEFT: Final = np.array([1.0, -1.0, 1.0, -1.0])  # 1 for left legs, −1 for right legs [4]

DEFAULT_POSE: Final = np.outer(FRONT, [0.0, 0.4, -0.8]).ravel() + 0.0
"""Joint angles of standing, rad [12]: HAA 0, HFE ±0.4, KFE ∓0.8 (front, hind)."""
STANDING_HEIGHT: Final = 0.5487  # m, base over the soles in DEFAULT_POSE
LIMITS: Final = np.array(
    [((-0.72, 0.49) if s > 0 else (-0.49, 0.72), (-9.42, 9.42), (-9.42, 9.42)) for s in LEFT]
).reshape(12, 2)
"""Lowest and highest joint angle, rad [12, 2]."""
TORQUE_LIMIT: Final = 80.0  # N·m

POSITION_GAIN: Final = 80.0  # N·m/rad, of the drives' position mode
VELOCITY_GAIN: Final = 2.0  # N·m·s/rad, of position mode and damping

HIP_IN_BASE: Final = np.array([0.2999, 0.104, 0.0])  # m
THIGH_IN_HIP: Final = np.array([0.0599, 0.0838, 0.0])  # m
SHANK_IN_THIGH: Final = np.array([0.0, 0.1003, -0.285])  # m
FOOT_IN_SHANK: Final = np.array([0.0880, 0.0131, -0.3155])  # m, centre of the foot's sphere
FOOT_RADIUS: Final = 0.03  # m

ROBOT_MASS: Final = 52.135  # kg, of all links
BASE_MASS: Final = 26.373  # kg
HIP_MASS: Final = 2.781  # kg
THIGH_MASS: Final = 3.071  # kg
SHANK_MASS: Final = 0.5884  # kg
BASE_CENTRE: Final = np.array([-0.0178, -0.0002, 0.0085])  # m, centre of mass in the base's frame
HIP_CENTRE: Final = np.array([0.0567, 0.0174, -0.0005])  # m, and of the links in their own
THIGH_CENTRE: Final = np.array([0.0, 0.0308, -0.2457])  # m
SHANK_CENTRE: Final = np.array([0.0613, 0.0055, -0.0807])  # m


GRAVITY: Final = 9.81  # m/s²
