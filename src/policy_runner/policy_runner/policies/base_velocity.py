"""Estimate of the base velocity from legs and IMU."""

from typing import Final

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.anymal import FOOT_RADIUS
from wattwalk_core.physics import GRAVITY

from policy_runner.policies.kinematics import forward

Floats = NDArray[np.float64]

_SETTLING: Final = 0.12  # s, in which the legs correct the accelerometer
_BLIND_SETTLING: Final = 0.04  # s, the same without an accelerometer
_RISE: Final = 0.006  # m above the lowest foot at which a foot counts half
_LONGEST_STEP: Final = 0.1  # s


class BaseVelocity:
    """
    Complementary filter: integration of the accelerometer, corrected by stance feet.

    A foot that stands moves, seen from the base, as the ground does; the lowest foot stands, and
    so does one that is hardly higher.
    """

    def __init__(self) -> None:
        self._time: float | None = None
        self.velocity = np.zeros(3)

    def reset(self) -> None:
        """Reset to a robot that stands."""
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
        acceleration: Floats | None = None,
    ) -> Floats:
        """
        Return the velocity in the base's frame, m/s [3].

        position rad [12], joint_velocity rad/s [12], gravity unit vector [3], rate rad/s [3], and
        acceleration (with gravity, as an IMU feels it) m/s² [3] if known.
        """
        dt = 0.0 if self._time is None else min(max(time - self._time, 0.0), _LONGEST_STEP)
        self._time = time
        legs = forward(position)
        turning = joint_velocity.reshape(4, 3)
        swept = np.einsum('nij,nj->ni', legs.jacobian, turning)
        down = FOOT_RADIUS * gravity
        soles = legs.feet + down
        rolling = np.cross(_shank_rates(legs.angles, turning), down)
        by_leg = -(swept + rolling + np.cross(rate, soles))
        depth = soles @ gravity
        weight = np.exp2(-np.square((depth.max() - depth) / _RISE))
        guess = self.velocity
        if acceleration is not None:
            guess = guess + dt * (acceleration + GRAVITY * gravity - np.cross(rate, guess))
        settling = _BLIND_SETTLING if acceleration is None else _SETTLING
        share = 1.0 - np.exp(-dt / settling)
        self.velocity = guess + share * (weight @ by_leg / weight.sum() - guess)
        return self.velocity


def _shank_rates(angles: Floats, turning: Floats) -> Floats:
    """Return the angular velocity of each shank in the base, rad/s [4, 3]; round feet roll."""
    haa, pitching = angles[:, 0], turning[:, 1] + turning[:, 2]
    return np.column_stack([turning[:, 0], pitching * np.cos(haa), pitching * np.sin(haa)])
