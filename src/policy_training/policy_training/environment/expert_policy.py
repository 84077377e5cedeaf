"""Scripted trots at the head of an environment's robots, where there is no policy yet."""

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from policy_runner.policies.trot import ScriptedTrot, TrotConfig
from wattwalk_core.anymal import DEFAULT_POSE

from policy_training.environment.environment import WalkingEnvironment

Floats = NDArray[np.float64]

RAMP: Final = 0.3  # s from the pose of a start to standing


class Leaders:
    """One trot for each robot; it senses what is so, and is told what the robot is shown."""

    def __init__(self, environment: WalkingEnvironment, gait: TrotConfig) -> None:
        self._environment = environment
        self._trots = [ScriptedTrot(replace(gait, ramp=RAMP)) for _ in range(environment.count)]
        self._time = 0.0

    @property
    def strides(self) -> list[float]:
        """Phase of each robot's gait, 0..1."""
        return [trot.stride for trot in self._trots]

    def actions(self) -> Floats:
        """What the trots do now, as `WalkingEnvironment.step` takes it [N, 12]."""
        motion, shown = self._environment.motion, self._environment.shown.values
        config = self._environment.config
        self._time += config.step_time
        targets = [
            trot.step(
                self._time,
                shown[robot],
                motion.position[robot],
                motion.gravity[robot],
                motion.rate[robot],
                motion.velocity[robot],
            )
            for robot, trot in enumerate(self._trots)
        ]
        return np.asarray((np.stack(targets) - DEFAULT_POSE) / config.action_scale)

    def reset(self, done: NDArray[np.bool_]) -> None:
        """Begin anew at the head of robots that did [N]."""
        for robot in np.flatnonzero(done):
            self._trots[robot].reset()
