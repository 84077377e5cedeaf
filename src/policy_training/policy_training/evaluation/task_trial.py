"""Trials of a policy on the tasks: power, tracking and falls of calm and of pushed robots.

The same seed gives the same robots and pushes. Much faster than `evaluate`, and without its meter,
supply and sensors: for choosing checkpoints, not for results.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
from policy_runner.policies.observations import Observation
from sim_bridge.plant.parameters import Plant
from wattwalk_core.arrays import Bools, Floats

from policy_training.config import TrainingConfig, TrialConfig
from policy_training.environment.environment import WalkingEnvironment
from policy_training.environment.power_term import PlantPower
from policy_training.evaluation.tasks import TASKS

_SETTLED: Final = 3.0  # s from the start that do not count
_FREE: Final = (0.03, 0.05)  # m/s, rad/s: errors without a penalty


class Walker(Protocol):
    """Controllers of all robots of an environment."""

    def actions(self) -> Floats:
        """Return the actions of the next step [N, 12]."""

    def reset(self, done: Bools) -> None:
        """Reset the controllers of robots that were reset [N]."""


@dataclass(frozen=True)
class TrialScore:
    """Result of one controller: mean over the tasks, and power by task."""

    cost: float  # W, with penalties
    power: float  # W, of the twelve drives, calm
    knees: float  # W, of the four KFE of them
    falls: float  # share of the pushed robots that fell
    speed_error: float  # m/s, of the worst task
    yaw_error: float  # rad/s, of the worst task
    by_task: dict[str, float]  # W


class TaskTrial:
    """Robots that walk the tasks, in turns of calm and pushed ones."""

    def __init__(
        self,
        config: TrialConfig,
        threads: int = 0,
        *,
        observation: Observation | None = None,
        action_scale: float = 0.5,
        plant: str = 'anymal_c',
    ) -> None:
        """observation, action_scale: of a learned policy."""
        self._config = config
        self._observation = observation
        each = config.calm + config.pushed
        self._training = _level_world(config, len(TASKS) * each, threads).with_values(
            {'action_scale': action_scale, 'physics.plant': plant}
        )
        self._plant = Plant.load(self._training.physics.plant)
        self._commands = np.repeat([task.command for task in TASKS], each, axis=0)
        self._pushed = np.tile(np.arange(each) >= config.calm, len(TASKS))

    def run(self, walker_of: Callable[[WalkingEnvironment], Walker], seed: int) -> TrialScore:
        """Return the score of a controller."""
        config = self._config
        environment = WalkingEnvironment(
            self._training.with_values({'seed': seed}), observation=self._observation
        )
        environment.age[:] = 0
        walker = walker_of(environment)
        meter = PlantPower(self._plant, environment.count, self._training.physics.timestep)
        step = self._training.step_time
        rows = round(config.seconds / step)
        watts = np.zeros((environment.count, 12))
        reached = np.zeros((environment.count, 3))
        counted = np.zeros(environment.count)
        fell = np.zeros(environment.count, bool)
        every = round(config.push_period / step)
        for row in range(rows):
            environment.commands.values[:] = self._commands
            outcome = environment.step(walker.actions())
            walker.reset(outcome.done)
            fell |= outcome.done
            if row * step >= _SETTLED:
                good = ~fell
                motion = environment.motion
                watts += meter.drives(environment.robots.substeps) * good[:, None]
                speed = np.column_stack([motion.velocity[:, :2], motion.rate[:, 2]])
                reached += speed * good[:, None]
                counted += good
            if config.pushed and row % every == every - 1:
                environment.push(np.flatnonzero(self._pushed))
        shape = (len(TASKS), config.calm + config.pushed)
        mean = np.maximum(counted, 1.0)[:, None]
        error = (reached / mean - self._commands).reshape(*shape, 3)
        return _score(
            config,
            (watts / mean).reshape(*shape, 12),
            error,
            (counted / rows).reshape(shape),
            fell.reshape(shape),
        )


def _score(
    config: TrialConfig, watts: Floats, error: Floats, lasted: Floats, fell: Bools
) -> TrialScore:
    """Return the score of a controller from [tasks, robots, …]."""
    calm = slice(0, config.calm)
    stood = np.where(lasted[:, calm] > 0.0, 1.0, np.nan)
    by_task = np.nan_to_num(
        np.nanmean(watts[:, calm].sum(axis=2) * stood, axis=1), nan=2.0 * config.fall_price
    )
    knees = watts[:, calm, 2::3].sum(axis=2).mean()
    away = np.abs(error[:, calm].mean(axis=1))
    speed, yaw = float(np.hypot(away[:, 0], away[:, 1]).max()), float(away[:, 2].max())
    falls = float(fell[:, config.calm :].mean()) if config.pushed else 0.0
    calm_falls = float(fell[:, calm].mean())
    cost = (
        float(by_task.mean())
        + config.speed_price * max(speed - _FREE[0], 0.0)
        + config.yaw_price * max(yaw - _FREE[1], 0.0)
        + config.fall_price * (falls + 2.0 * calm_falls)
    )
    names = [task.name for task in TASKS]
    return TrialScore(
        cost=cost,
        power=float(by_task.mean()),
        knees=float(knees),
        falls=falls,
        speed_error=speed,
        yaw_error=yaw,
        by_task=dict(zip(names, by_task.tolist(), strict=True)),
    )


def _level_world(config: TrialConfig, robots: int, threads: int) -> TrainingConfig:
    """Return level ground with the spread of drives, payloads and friction of training."""
    return TrainingConfig().with_values(
        {
            'physics.environments': robots,
            'physics.threads': threads,
            'physics.episode': config.seconds + 10.0,
            'physics.slope': 0.0,
            'physics.noise': 0.005,
            'commands.period': 600.0,
            'commands.ramp_from': 1.0,
            'commands.ramp_steps': 0.0,
            'random.push': config.push,
            'random.push_period': 600.0,
            'random.resting': 1.0,
            'noise.clean': 1.0,
        }
    )
