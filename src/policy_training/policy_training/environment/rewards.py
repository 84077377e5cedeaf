"""Rewards of legged_gym's flat ANYmal for N robots at once; power is in `environment.py`."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.anymal import DEFAULT_POSE
from wattwalk_core.arrays import Bools, Floats

from policy_training.config import RewardConfig
from policy_training.environment.robots import RobotMotion

_TOUCHING: Final = 1.0  # N


@dataclass(frozen=True)
class RewardState:
    """Motion, command and action of N robots after one step."""

    motion: RobotMotion
    command: Floats  # m/s, m/s, rad/s [N, 3]
    walking: Bools  # steps are due by the command [N]
    action: Floats  # [N, 12]
    last_action: Floats  # [N, 12]
    acceleration: Floats  # rad/s² [N, 12], of the joints
    flight: Floats  # s [N], time in the air beyond the target of feet that land now
    sigma: float  # width of the tracking rewards, (m/s)² or (rad/s)²


REWARDS: Final[Mapping[str, Callable[[RewardState], Floats]]] = {
    # tracking of vx and vy, and of the yaw rate, 0..1
    'tracking_lin_vel': lambda s: np.exp(
        -_square_sum(s.command[:, :2] - s.motion.velocity[:, :2]) / s.sigma
    ),
    'tracking_ang_vel': lambda s: np.exp(
        -np.square(s.command[:, 2] - s.motion.rate[:, 2]) / s.sigma
    ),
    # squared vertical velocity, m²/s²
    'lin_vel_z': lambda s: np.square(s.motion.velocity[:, 2]),
    # squared roll and pitch rate, rad²/s²
    'ang_vel_xy': lambda s: _square_sum(s.motion.rate[:, :2]),
    # squared sine of the tilt
    'orientation': lambda s: _square_sum(s.motion.gravity[:, :2]),
    # squared torques on the joints, (N·m)²
    'torques': lambda s: _square_sum(s.motion.torque),
    # squared accelerations of the joints, rad²/s⁴
    'dof_acc': lambda s: _square_sum(s.acceleration),
    # time in the air beyond the target of feet that land while walking, s
    'feet_air_time': lambda s: s.flight * s.walking,
    # number of thighs and shanks on the ground
    'collision': lambda s: s.motion.collisions,
    # squared change of the actions
    'action_rate': lambda s: _square_sum(s.action - s.last_action),
    # distance from the default pose of robots that are to stand, rad
    'stand_still': lambda s: np.abs(s.motion.position - DEFAULT_POSE).sum(axis=1) * ~s.walking,
}
"""Functions of a state that give a reward before weighting [N], by the names of their weights."""


class FootClock:
    """Time in the air of each foot of N robots; step: s; target: s in the air to reach."""

    def __init__(self, count: int, step: float, target: float) -> None:
        self._step, self._target = step, target
        self.air: Floats = np.zeros((count, 4))  # s [N, 4]
        self._touched = np.ones((count, 4), bool)

    def start(self, ids: NDArray[np.intp]) -> None:
        """Reset the robots of these indices."""
        self.air[ids] = 0.0
        self._touched[ids] = True

    def land(self, force: Floats) -> Floats:
        """Advance by one step; return the summed time in the air beyond the target, s [N].

        Only feet that land now count. force: on the feet, N [N, 4].
        """
        touching = force > _TOUCHING
        firm = touching | self._touched
        self._touched = touching
        landing = (self.air > 0.0) & firm
        self.air += self._step
        flight = np.where(landing, self.air - self._target, 0.0).sum(axis=1)
        self.air[firm] = 0.0
        return np.asarray(flight)


class Rewards:
    """Weighted rewards of a step and their sum."""

    def __init__(self, config: RewardConfig, step: float) -> None:
        """step: s between two actions, which multiplies the weights."""
        self._only_positive = config.only_positive
        weights = {name: getattr(config, name) * step for name in REWARDS}
        self._weights = {name: weight for name, weight in weights.items() if weight}

    def terms(self, state: RewardState) -> dict[str, Floats]:
        """Return each reward times its weight, by name [N]; those of weight 0 are left out."""
        return {name: weight * REWARDS[name](state) for name, weight in self._weights.items()}

    def total(self, terms: dict[str, Floats]) -> Floats:
        """Return the sum [N], not below 0 where the config says so."""
        total = np.sum(list(terms.values()), axis=0)
        return np.maximum(total, 0.0) if self._only_positive else np.asarray(total)


def _square_sum(values: Floats) -> Floats:
    return np.asarray(np.square(values).sum(axis=1))
