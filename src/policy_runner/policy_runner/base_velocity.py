"""Velocity of the base from legs and IMU, where nobody measures it."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from policy_runner.kinematics import FOOT_RADIUS, GRAVITY, forward

Floats = NDArray[np.float64]

_SETTLING: Final = 0.06  # s, in which the legs correct the accelerometer
_BLIND_SETTLING: Final = 0.03  # s, the same without an accelerometer
_RISE: Final = 0.012  # m above the lowest foot at which a foot counts half
_LONGEST_STEP: Final = 0.1  # s


class BaseVelocity:
    """
    A complementary filter: the accelerometer carries on, feet that stand correct.

    A foot that stands moves, seen from the base, as the ground does. How surely it stands comes
    from the force that its leg exerts, where torques are known, and from its height above the
    lowest foot.
    """

    def __init__(self) -> None:
        self._time: float | None = None
        self.velocity = np.zeros(3)

    def reset(self) -> None:
        """Forget the past: the robot stands."""
        self._time = None
        self.velocity = np.zeros(3)

    def update(
        self,
        time: float,
        position: Floats,
        joint_velocity: Floats,
        gravity: Floats,
        rate: Floats,
        *,
        torque: Floats | None = None,
        acceleration: Floats | None = None,
    ) -> Floats:
        """
        Velocity in the base's frame now, m/s [3].

        position rad [12], joint_velocity rad/s [12], gravity unit vector [3], rate rad/s [3],
        torque N·m [12] and acceleration (with gravity, as an IMU feels it) m/s² [3] if known.
        """
        dt = 0.0 if self._time is None else min(max(time - self._time, 0.0), _LONGEST_STEP)
        self._time = time
        legs = forward(position)
        swept = np.einsum('nij,nj->ni', legs.jacobian, joint_velocity.reshape(4, 3))
        soles = legs.feet + FOOT_RADIUS * gravity
        by_leg = -(swept + np.cross(rate, soles))
        weight = self._standing(legs.jacobian, soles, gravity, torque)
        total = float(weight.sum())
        guess = self.velocity
        if acceleration is not None:
            guess = guess + dt * (acceleration + GRAVITY * gravity - np.cross(rate, guess))
        settling = _BLIND_SETTLING if acceleration is None else _SETTLING
        share = 1.0 - np.exp(-dt / settling * min(total, 1.0))
        if total > 1e-3:
            seen = weight @ by_leg / total
            guess = guess + share * (seen - guess)
        self.velocity = guess
        return guess

    def _standing(
        self, jacobian: Floats, soles: Floats, gravity: Floats, torque: Floats | None
    ) -> Floats:
        depth = soles @ gravity
        weight: Floats = np.exp2(-np.square((depth.max() - depth) / _RISE))
        if torque is not None:
            pushed = np.linalg.solve(
                np.swapaxes(jacobian, 1, 2) + 1e-3 * np.eye(3), torque.reshape(4, 3, 1)
            )[..., 0]
            load = np.maximum(pushed @ gravity, 0.0)
            weight *= load / max(float(load.max()), 20.0)
        return weight
