"""What is rewarded: the terms of legged_gym's flat ANYmal, for N robots at once."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.anymal import DEFAULT_POSE

from policy_training.config import RewardConfig
from policy_training.environment.robots import Motion

Floats = NDArray[np.float64]

_TOUCHING = 1.0  # N
_TRACKING = ('velocity', 'yaw')


@dataclass(frozen=True)
class Moment:
    """What rewards look at, beside the motion: N robots at one step."""

    command: Floats  # m/s, m/s, rad/s [N, 3]
    asked: NDArray[np.bool_]  # whether steps are asked for, by the command or to catch a fall [N]
    action: Floats  # [N, 12]
    last_action: Floats  # [N, 12]
    acceleration: Floats  # rad/s² [N, 12], of the joints
    flight: Floats  # s [N], time in the air beyond the target of feet that land now


class FootClock:
    """How long each foot has been in the air."""

    def __init__(self, count: int, step: float, target: float) -> None:
        self._step, self._target = step, target
        self.air: Floats = np.zeros((count, 4))  # s [N, 4]
        self._touched = np.ones((count, 4), bool)

    def start(self, ids: NDArray[np.intp]) -> None:
        """Forget the past of some robots."""
        self.air[ids] = 0.0
        self._touched[ids] = True

    def land(self, force: Floats) -> Floats:
        """
        How long feet that land now were in the air beyond the target, summed, s [N].

        force: on the feet, N [N, 4].
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
    """Weighted terms; what they add up to is the reward of a step."""

    def __init__(self, config: RewardConfig, step: float) -> None:
        """step: s between two actions, which weights are multiplied by."""
        self._config = config
        self._weights = {
            name: getattr(config, name) * step
            for name in (
                *('velocity', 'yaw', 'vertical', 'rolling', 'orientation', 'torque'),
                *('acceleration', 'air_time', 'collision', 'action_rate', 'standing'),
            )
            if getattr(config, name)
        }

    def terms(self, motion: Motion, moment: Moment, share: float = 1.0) -> dict[str, Floats]:
        """Each active term, weighted, [N]; of all but tracking a share."""
        return {
            name: weight * (1.0 if name in _TRACKING else share) * self._raw(name, motion, moment)
            for name, weight in self._weights.items()
        }

    def total(self, terms: dict[str, Floats]) -> Floats:
        """Sum of all terms [N], not below 0 where the config says so."""
        total = np.sum(list(terms.values()), axis=0)
        return np.maximum(total, 0.0) if self._config.only_positive else np.asarray(total)

    def _raw(self, name: str, motion: Motion, moment: Moment) -> Floats:
        sigma = self._config.sigma
        if name == 'velocity':
            away = moment.command[:, :2] - motion.velocity[:, :2]
            return np.asarray(np.exp(-_squares(away) / sigma))
        if name == 'yaw':
            return np.asarray(np.exp(-np.square(moment.command[:, 2] - motion.rate[:, 2]) / sigma))
        if name == 'vertical':
            return np.square(motion.velocity[:, 2])
        if name == 'rolling':
            return _squares(motion.rate[:, :2])
        if name == 'orientation':
            return _squares(motion.gravity[:, :2])
        if name == 'torque':
            return _squares(motion.torque)
        if name == 'acceleration':
            return _squares(moment.acceleration)
        if name == 'air_time':
            return moment.flight * moment.asked
        if name == 'collision':
            return motion.collisions
        if name == 'action_rate':
            return _squares(moment.action - moment.last_action)
        away = np.abs(motion.position - DEFAULT_POSE).sum(axis=1)
        return np.asarray(away * ~moment.asked)


def _squares(values: Floats) -> Floats:
    return np.asarray(np.square(values).sum(axis=1))
