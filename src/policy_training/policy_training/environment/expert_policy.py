"""Scripted trots as expert policies of an environment's robots."""

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from policy_runner.policies.trot import ScriptedTrot, TrotConfig
from wattwalk_core.anymal import DEFAULT_POSE

from policy_training.environment.environment import WalkingEnvironment

Floats = NDArray[np.float64]

RAMP: Final = 0.3  # s from the initial pose to standing


class ExpertPolicy:
    """One trot per robot, with the true state and the rate-limited command as inputs."""

    def __init__(self, environment: WalkingEnvironment, gait: TrotConfig) -> None:
        self._environment = environment
        self._trots = [ScriptedTrot(replace(gait, ramp=RAMP)) for _ in range(environment.count)]
        self._time = 0.0

    @property
    def phases(self) -> list[float]:
        """Gait phase of each robot, 0..1."""
        return [trot.stride for trot in self._trots]

    def actions(self) -> Floats:
        """Advance by a step and return actions for `WalkingEnvironment.step` [N, 12]."""
        motion, commands = self._environment.motion, self._environment.limiter.values
        config = self._environment.config
        self._time += config.step_time
        targets = [
            trot.step(
                self._time,
                commands[robot],
                motion.position[robot],
                motion.gravity[robot],
                motion.rate[robot],
                motion.velocity[robot],
            )
            for robot, trot in enumerate(self._trots)
        ]
        return np.asarray((np.stack(targets) - DEFAULT_POSE) / config.action_scale)

    def reset(self, done: NDArray[np.bool_]) -> None:
        """Reset the trots of robots that were reset [N]."""
        for robot in np.flatnonzero(done):
            self._trots[robot].reset()
