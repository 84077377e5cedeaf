"""Scripted trots as expert policies of an environment's robots."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from policy_runner.policies.trot import ScriptedTrots, TrotConfig
from policy_runner.policies.trot_gait import GaitTable
from wattwalk_core.anymal import DEFAULT_POSE
from wattwalk_core.arrays import Bools, Floats

from policy_training.environment.environment import WalkingEnvironment

RAMP: Final = 0.3  # s from the initial pose to standing


class ExpertPolicy:
    """A trot for each robot, with the true state and the rate-limited command as inputs."""

    def __init__(
        self,
        environment: WalkingEnvironment,
        gaits: Sequence[TrotConfig],
        table: GaitTable | None = None,
    ) -> None:
        """gaits: one for each robot, or one for all. table: what replaces them by command."""
        count = environment.count
        each = gaits if len(gaits) == count else [gaits[0]] * count
        self._environment = environment
        self._trots = ScriptedTrots([replace(gait, ramp=RAMP) for gait in each], table)
        self._time = 0.0

    @property
    def phases(self) -> Floats:
        """Gait phase of each robot, 0..1 [N]."""
        return self._trots.stride

    def actions(self) -> Floats:
        """Advance by a step and return actions for `WalkingEnvironment.step` [N, 12]."""
        motion, config = self._environment.motion, self._environment.config
        self._time += config.step_time
        targets = self._trots.step(
            self._time,
            self._environment.limiter.values,
            motion.position,
            motion.gravity,
            motion.rate,
            motion.velocity,
        )
        return np.asarray((targets - DEFAULT_POSE) / config.action_scale)

    def reset(self, done: Bools) -> None:
        """Reset the trots of robots that were reset [N]."""
        if done.any():
            self._trots.reset(np.flatnonzero(done))
