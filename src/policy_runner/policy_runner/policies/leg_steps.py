"""Kinematics and stance torques of the legs of N robots, compiled."""

from math import acos, atan2, cos, hypot, pi, sin, sqrt
from typing import Final

import numpy as np
from wattwalk_core.arrays import Floats
from wattwalk_core.compiled import compiled

_FOOT_FORCE_LIMIT: Final = 500.0  # N, normal, of one foot
_PUSH_LIMIT: Final = 120.0  # N, horizontal, of all feet


@compiled('void(f8[:, ::1], f8[::1], f8[:, :, ::1], f8[:, :, ::1], f8[:, :, :, ::1])')
def forward_steps(
    legs: Floats, lengths: Floats, angles: Floats, feet: Floats, jacobian: Floats
) -> None:
    """Write feet, m [N, 4, 3], and Jacobians, m/rad [N, 4, 3, 3], at angles, rad [N, 4, 3].

    legs [7, 4]: hip x, y and z, offset ahead and aside, m, bend of the shank, rad, and 1 for front
    legs, −1 for hind ones. lengths: of thigh and shank, nearest and farthest reach of a leg, m.
    """
    thigh, shank = lengths[0], lengths[1]
    for n in range(len(angles)):
        for leg in range(4):
            haa, hfe, kfe = angles[n, leg]
            low = hfe + kfe + legs[5, leg]
            shank_x, shank_z = -shank * sin(low), -shank * cos(low)
            x, z = -thigh * sin(hfe) + shank_x, -thigh * cos(hfe) + shank_z
            c, s = cos(haa), sin(haa)
            y_foot, z_foot = legs[4, leg] * c - z * s, legs[4, leg] * s + z * c
            feet[n, leg, 0] = legs[3, leg] + x + legs[0, leg]
            feet[n, leg, 1] = y_foot + legs[1, leg]
            feet[n, leg, 2] = z_foot + legs[2, leg]
            turn = jacobian[n, leg]
            turn[0, 0] = 0.0
            turn[1, 0] = -z_foot
            turn[2, 0] = y_foot
            turn[0, 1] = z
            turn[1, 1] = x * s
            turn[2, 1] = -x * c
            turn[0, 2] = shank_z
            turn[1, 2] = shank_x * s
            turn[2, 2] = -shank_x * c


@compiled('void(f8[:, ::1], f8[::1], f8[:, :, ::1], f8[:, :, ::1])')
def inverse_steps(legs: Floats, lengths: Floats, feet: Floats, angles: Floats) -> None:
    """Write joint angles, rad [N, 4, 3], for feet at places in the base's frame, m [N, 4, 3].

    legs, lengths: as of `forward_steps`.
    """
    thigh, shank, nearest, farthest = lengths
    for n in range(len(feet)):
        for leg in range(4):
            aside = legs[4, leg]
            x = feet[n, leg, 0] - legs[0, leg]
            y, z = feet[n, leg, 1] - legs[1, leg], feet[n, leg, 2] - legs[2, leg]
            side = hypot(y, z)
            drop = -sqrt(max(side * side - aside * aside, 1e-4))
            haa = atan2(z, y) - atan2(drop, aside)
            x = x - legs[3, leg]
            reach = min(max(hypot(x, drop), nearest), farthest)
            fold = (reach * reach - thigh * thigh - shank * shank) / (2.0 * thigh * shank)
            knee = -legs[6, leg] * acos(fold)
            low = atan2(shank * sin(knee), thigh + shank * cos(knee))
            angles[n, leg, 0] = (haa + pi) % (2.0 * pi) - pi
            angles[n, leg, 1] = atan2(-x, -drop) - low
            angles[n, leg, 2] = knee - legs[5, leg]


@compiled('void(f8[:, ::1], f8[::1], f8[:, :, ::1], f8[:, ::1], f8[:, :, ::1])')
def weight_steps(
    legs: Floats, masses: Floats, angles: Floats, pull: Floats, torque: Floats
) -> None:
    """Write the torques that carry the legs' own weight, N·m [N, 4, 3], at angles, rad [N, 4, 3].

    legs [2, 4]: moment aside, kg·m, and the shank's centre ahead, m. masses: thigh and shank, kg;
    thigh's length, its centre's share of it and the shank's centre along z, m. pull: of gravity in
    the base's frame, m/s² [N, 3].
    """
    thigh_mass, shank_mass, thigh, share, centre_z = masses
    for n in range(len(angles)):
        for leg in range(4):
            haa, hfe, kfe = angles[n, leg]
            c, s = cos(haa), sin(haa)
            pull_x = pull[n, 0]
            pull_y = c * pull[n, 1] + s * pull[n, 2]
            pull_z = c * pull[n, 2] - s * pull[n, 1]
            knee_x, knee_z = -thigh * sin(hfe), -thigh * cos(hfe)
            cs, ss = cos(hfe + kfe), sin(hfe + kfe)
            shank_x = legs[1, leg] * cs + centre_z * ss
            shank_z = centre_z * cs - legs[1, leg] * ss
            moment_x = thigh_mass * (share * knee_x) + shank_mass * (knee_x + shank_x)
            moment_z = thigh_mass * (share * knee_z) + shank_mass * (knee_z + shank_z)
            torque[n, leg, 0] = moment_z * pull_y - legs[0, leg] * pull_z
            torque[n, leg, 1] = moment_x * pull_z - moment_z * pull_x
            torque[n, leg, 2] = shank_mass * (shank_x * pull_z - shank_z * pull_x)


@compiled('void(f8[::1], f8[:, ::1], f8[:, :, ::1], f8[::1], f8[:, ::1], f8[:, ::1])')
def stance_steps(
    gains: Floats, feet: Floats, jacobian: Floats, load: Floats, body: Floats, torque: Floats
) -> None:
    """Write joint torques of stance legs, N·m [4, 3]; see `trot.stance_torque`.

    gains [8]: height, tilt, tilt_rate, velocity, yaw, the commanded height, m, the robot's weight,
    N, and the radius of a foot, m. body [3, 3]: direction of gravity, spin and velocity error.
    """
    gram, wrench = 1e-3 * np.eye(3), np.empty(3)
    arms = np.stack((np.ones(4), feet[:, 1], -feet[:, 0]))
    lift, tilt, rate, pace, yaw, height, weight, radius = gains
    gravity, spin, error = body
    total = load.sum()
    reached = radius - (load * feet[:, 2]).sum() / max(total, 0.1)
    wrench[0] = weight + lift * min(max(height - reached, -0.05), 0.05)
    wrench[1] = tilt * gravity[1] - rate * spin[0]
    wrench[2] = -tilt * gravity[0] - rate * spin[1]
    for i in range(3):
        for j in range(3):
            for leg in range(4):
                gram[i, j] += load[leg] * arms[i, leg] * arms[j, leg]
    for i in range(3):  # positive definite: Gauss elimination needs no pivots
        for row in range(i + 1, 3):
            share = gram[row, i] / gram[i, i]
            gram[row, i:] -= share * gram[i, i:]
            wrench[row] -= share * wrench[i]
    for i in (2, 1, 0):
        for j in range(i + 1, 3):
            wrench[i] -= gram[i, j] * wrench[j]
        wrench[i] /= gram[i, i]
    normal = load * arms[0] * wrench[0] + load * arms[1] * wrench[1] + load * arms[2] * wrench[2]
    normal = np.minimum(np.maximum(normal, 0.0), _FOOT_FORCE_LIMIT if total >= 0.1 else 0.0)
    part = normal / max(normal.sum(), 50.0)
    push = np.minimum(np.maximum(pace * error, -_PUSH_LIMIT), _PUSH_LIMIT)
    inertia = 1e-3
    for leg in range(4):
        inertia += part[leg] * (feet[leg, 0] ** 2 + feet[leg, 1] ** 2)
    twist = yaw * error[2] / inertia
    for leg in range(4):
        x_force = part[leg] * (push[0] - twist * feet[leg, 1]) - gravity[0] * normal[leg]
        y_force = part[leg] * (push[1] + twist * feet[leg, 0]) - gravity[1] * normal[leg]
        z_force = -gravity[2] * normal[leg]
        for i in range(3):
            turn = jacobian[leg, :, i]
            torque[leg, i] = -(x_force * turn[0] + y_force * turn[1] + z_force * turn[2])
