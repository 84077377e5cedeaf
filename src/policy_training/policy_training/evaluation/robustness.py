"""Robustness evaluation: many robots on rough ground, pushed, under changing commands."""

from dataclasses import dataclass
from typing import Annotated, Final

import numpy as np
from numpy.typing import NDArray
from policy_runner.policies.folder import Contract
from policy_runner.policies.learned import Network
from scipy.stats import binomtest
from wattwalk_core.anymal import DEFAULT_POSE, JOINT_NAMES
from wattwalk_core.arrays import Bools, Floats
from wattwalk_core.errors import InputError
from wattwalk_core.schema import CheckedFields, Quantity

from policy_training.config import TrainingConfig
from policy_training.environment.environment import WalkingEnvironment
from policy_training.evaluation.tasks import AXES

LIMITS: Final = (0.15, 0.15, 0.2)  # m/s, m/s, rad/s, mean tracking errors of a policy that walks
_SETTLED: Final = 2.0  # s after a new command that do not count
_PUSHED: Final = 2.0  # s after a push that do not count


@dataclass(frozen=True)
class RobustnessConfig(CheckedFields):
    """Number of robots, duration, plant, and the range of their commands, m/s and rad/s."""

    robots: Annotated[int, Quantity(1, 4096)] = 64
    seconds: Annotated[float, Quantity(4.0, 600.0, 's')] = 20.0
    forward: float = 1.0
    lateral: float = 0.6
    yaw: float = 1.0
    seed: int = 1001
    plant: str = 'anymal_c_published'


@dataclass(frozen=True)
class RobustnessResult:
    """Falls and tracking errors.

    Errors are of the mean velocity under one command, without the first 2 s and the 2 s after
    a push: their mean size and the 95th percentile.
    """

    robots: int
    seconds: float
    falls: int  # robots that fell
    fell_95: tuple[float, float]  # share, 95 % interval (Wilson)
    mean_error: dict[str, float]  # vx, vy m/s, yaw rad/s
    error_95: dict[str, float]
    following: bool  # no falls, and mean errors within 0.15 m/s and 0.2 rad/s


def evaluate_robustness(
    contract: Contract, network: Network, config: RobustnessConfig, *, threads: int = 0
) -> RobustnessResult:
    """Evaluate a learned policy with the noise, spread of drives, delays and pushes of training.

    InputError for a policy whose joints, pose or scale differ from those of training.
    """
    environment = WalkingEnvironment(
        rough_world(config, threads).with_values({'action_scale': _scale_of(contract)}),
        observation=contract.observation,
    )
    environment.age[:] = 0
    step = environment.config.step_time
    count = round(config.seconds / step)
    commands = np.empty((count, config.robots, 3))
    reached = np.empty_like(commands)
    fell = np.zeros((count, config.robots), bool)
    observation = environment.observe()
    for index in range(count):
        commands[index] = environment.commands.values
        outcome = environment.step(network(observation))
        observation = outcome.observation
        fell[index] = outcome.done & ~outcome.timed_out
        motion = environment.motion
        reached[index] = np.column_stack([motion.velocity[:, :2], motion.rate[:, 2]])
    pushed = np.zeros_like(fell)
    every = round(environment.config.random.push_period / step)
    pushed[every - 1 :: every] = True
    return _judge(config, commands, reached, fell, pushed, step)


def rough_world(config: RobustnessConfig, threads: int = 0) -> TrainingConfig:
    """Return the training config of the evaluation: rough ground, a push every 7 s."""
    return TrainingConfig().with_values(
        {
            'seed': config.seed,
            'physics.plant': config.plant,
            'physics.environments': config.robots,
            'physics.threads': threads,
            'physics.episode': config.seconds + 1,
            'commands.forward': config.forward,
            'commands.lateral': config.lateral,
            'commands.yaw': config.yaw,
            'commands.standing': 0.1,
            'commands.single': 0.3,
            'physics.noise': 0.02,
            'physics.slope': 0.02,
            'random.push_period': 7.0,
            'random.resting': 0.0,
        }
    )


def _scale_of(contract: Contract) -> float:
    scale, *others = contract.ordered(contract.action.scale).tolist()
    same = (
        contract.joints == JOINT_NAMES
        and np.allclose(contract.ordered(contract.default_pose), DEFAULT_POSE, atol=1e-4)
        and np.allclose(others, scale)
    )
    if not same or abs(contract.rate * TrainingConfig().step_time - 1.0) > 1e-6:
        raise InputError(
            f'policy {contract.name!r}: trials need the order of joints, the default pose and '
            'the rate of training'
        )
    return float(scale)


def _judge(
    config: RobustnessConfig,
    commands: Floats,
    reached: Floats,
    fell: Bools,
    pushed: Bools,
    step: float,
) -> RobustnessResult:
    changed = np.ones(fell.shape, bool)
    changed[1:] = (np.diff(commands, axis=0) != 0.0).any(axis=2)
    fresh = _since(changed) < _SETTLED / step
    since = _since(pushed | fell)
    shaken = (since >= 0) & (since < _PUSHED / step)
    counted = ~fresh & ~shaken
    piece = np.cumsum(changed, axis=0)
    errors = []
    for robot in range(config.robots):
        for number in range(1, int(piece[-1, robot]) + 1):
            rows = counted[:, robot] & (piece[:, robot] == number)
            if rows.sum() * step >= 0.5:
                errors.append((commands[rows, robot] - reached[rows, robot]).mean(axis=0))
    size = np.abs(np.array(errors)) if errors else np.full((1, 3), np.nan)
    mean, high = size.mean(axis=0), np.quantile(size, 0.95, axis=0)
    falls = int(fell.any(axis=0).sum())
    chance = binomtest(falls, config.robots).proportion_ci(method='wilson')
    return RobustnessResult(
        robots=config.robots,
        seconds=config.seconds,
        falls=falls,
        fell_95=(float(chance.low), float(chance.high)),
        mean_error=dict(zip(AXES, map(float, mean), strict=True)),
        error_95=dict(zip(AXES, map(float, high), strict=True)),
        following=falls == 0 and bool((mean <= LIMITS).all()),
    )


def _since(marks: Bools) -> NDArray[np.intp]:
    """Return the steps since the last mark in each column; negative before the first."""
    index = np.arange(len(marks))[:, None]
    last = np.maximum.accumulate(np.where(marks, index, -(10**9)), axis=0)
    return np.where(last < 0, -1, index - last)
