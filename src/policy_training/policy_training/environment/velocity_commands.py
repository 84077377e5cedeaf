"""Velocity commands for N robots."""

import numpy as np
from numpy.typing import NDArray
from policy_runner.policies.gait_phase import DEAD_ZONE

from policy_training.config import CommandConfig

Floats = NDArray[np.float64]


class VelocityCommands:
    """Random velocity commands in a range that widens during training."""

    def __init__(self, config: CommandConfig, count: int, random: np.random.Generator) -> None:
        self._config = config
        self._random = random
        self._top = np.array([config.forward, config.lateral, config.yaw])
        self.values = np.zeros((count, 3))

    def share(self, steps: float) -> float:
        """Return the share of the range in use after a number of policy steps."""
        c = self._config
        done = 1.0 if steps >= c.ramp_steps else steps / c.ramp_steps
        return c.ramp_from + (1.0 - c.ramp_from) * done

    def draw(self, ids: NDArray[np.intp], steps: float) -> None:
        """Draw commands of some robots: along one axis, along all, or to stand still."""
        c, random, count = self._config, self._random, len(ids)
        top = self.share(steps) * self._top
        values = random.uniform(-top, top, (count, 3))
        kind = random.uniform(size=count)
        axis = random.integers(3, size=count)
        alone = kind < c.single
        values[alone] *= np.eye(3)[axis[alone]]
        values[kind >= 1.0 - c.standing] = 0.0
        values[np.linalg.norm(values, axis=1) < DEAD_ZONE] = 0.0
        self.values[ids] = values
