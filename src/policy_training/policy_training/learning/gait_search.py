"""
Search of the scripted gait that draws least power, by CMA-ES.

Each candidate walks all tasks, calm and pushed. Its cost is the mean power of the drives on calm
robots plus penalties in watts for tracking errors and for falls of pushed robots: a gait is a
reference for policies only if it stays on its feet.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Final

import numpy as np
from numpy.typing import NDArray
from policy_runner.policies.gait_phase import CADENCE_ADAPTATION
from policy_runner.policies.trot import TrotConfig
from sim_bridge.plant.parameters import Plant
from wattwalk_core.schema import Quantity, schema

from policy_training.config import TrainingConfig
from policy_training.environment.environment import WalkingEnvironment
from policy_training.environment.expert_policy import ExpertPolicy
from policy_training.environment.plant_power import PlantPower
from policy_training.evaluation.tasks import TASKS

Floats = NDArray[np.float64]

RANGES: Final[Mapping[str, tuple[float, float]]] = {
    'frequency': (1.0, 2.0),
    'frequency_per_speed': (0.0, 1.2),
    'stance_speed': (0.6, 1.2),
    'duty': (0.52, 0.7),
    'height': (0.50, 0.61),
    'swing_height': (0.015, 0.09),
    'foot_x': (0.28, 0.44),
    'foot_y': (0.13, 0.30),
    'damping': (1.0, 4.5),
    'urgent_duty': (0.5, 0.65),
    'urgent_height': (0.48, 0.60),
    'urgent_swing_height': (0.04, 0.14),
    'urgent_foot_x': (0.30, 0.46),
    'urgent_foot_y': (0.22, 0.36),
}
"""What is searched, lowest and highest."""

_SETTLED: Final = 3.0  # s from the start that do not count
_FREE: Final = (0.03, 0.05)  # m/s, rad/s: errors without a penalty


@schema
class GaitSearchConfig:
    """Size of a search and prices of what is not power."""

    seed: Annotated[int, Quantity(0, 2**31 - 1)] = 1
    population: Annotated[int, Quantity(4, 256, '', 'gaits in a generation')] = 14
    calm: Annotated[int, Quantity(1, 64, '', 'robots that walk a task undisturbed')] = 2
    pushed: Annotated[int, Quantity(0, 64, '', 'robots that are pushed in a task')] = 4
    seconds: Annotated[float, Quantity(5.0, 60.0, 's', 'of walking')] = 9.0
    push: Annotated[float, Quantity(0.0, 3.0, 'm/s', 'along x and y, ±')] = 1.4
    push_period: Annotated[float, Quantity(1.0, 60.0, 's')] = 2.5
    speed_price: Annotated[float, Quantity(0.0, 1e5, 'W per m/s')] = 1500.0
    yaw_price: Annotated[float, Quantity(0.0, 1e5, 'W per rad/s')] = 600.0
    fall_price: Annotated[float, Quantity(0.0, 1e5, 'W', 'if all fall')] = 500.0
    step: Annotated[float, Quantity(0.01, 1.0, '', 'initial, share of the ranges')] = 0.15


@dataclass(frozen=True)
class GaitScore:
    """Result of one gait: mean over the tasks, and power by task."""

    cost: float  # W, with penalties
    power: float  # W, of the twelve drives, calm
    knees: float  # W, of the four KFE of them
    falls: float  # share of the pushed robots that fell
    speed_error: float  # m/s, of the worst task
    yaw_error: float  # rad/s, of the worst task
    by_task: dict[str, float]  # W


class GaitTrial:
    """Robots that walk the tasks, in turns of calm and pushed ones, for each of P gaits."""

    def __init__(self, config: GaitSearchConfig, gaits: int, threads: int = 0) -> None:
        self._config = config
        self._each = config.calm + config.pushed
        count = gaits * len(TASKS) * self._each
        self._training = _level_world(config, count, threads)
        self._plant = Plant.load(self._training.physics.plant)
        command = np.repeat([task.command for task in TASKS], self._each, axis=0)
        self._commands = np.tile(command, (gaits, 1))
        pushed = np.arange(self._each) >= config.calm
        self._pushed = np.tile(pushed, gaits * len(TASKS))

    def run(self, gaits: Sequence[TrotConfig], seed: int) -> list[GaitScore]:
        """Return the scores of gaits; the same seed gives all of them the same pushes."""
        config = self._config
        environment = WalkingEnvironment(self._training.with_values({'seed': seed}))
        environment.age[:] = 0
        per_gait = len(TASKS) * self._each
        expert = ExpertPolicy(environment, [g for g in gaits for _ in range(per_gait)])
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
            outcome = environment.step(expert.actions())
            expert.reset(outcome.done)
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
        shape = (len(gaits), len(TASKS), self._each)
        mean = np.maximum(counted, 1.0)[:, None]
        error = (reached / mean - self._commands).reshape(*shape, 3)
        return [
            _score(config, *parts)
            for parts in zip(
                (watts / mean).reshape(*shape, 12),
                error,
                (counted / rows).reshape(shape),
                fell.reshape(shape),
                strict=True,
            )
        ]


def _score(
    config: GaitSearchConfig, watts: Floats, error: Floats, lasted: Floats, fell: NDArray[np.bool_]
) -> GaitScore:
    """Return the score of one gait from [tasks, robots, …]."""
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
    return GaitScore(
        cost=cost,
        power=float(by_task.mean()),
        knees=float(knees),
        falls=falls,
        speed_error=speed,
        yaw_error=yaw,
        by_task=dict(zip(names, by_task.tolist(), strict=True)),
    )


def _level_world(config: GaitSearchConfig, robots: int, threads: int) -> TrainingConfig:
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


def start_of(gait: TrotConfig) -> TrotConfig:
    """Return a gait that may hurry and that reaches the commands of the tasks."""
    return replace(gait, cadence_adaptation=CADENCE_ADAPTATION, max_forward=1.2, max_yaw=1.2)


def to_gait(start: TrotConfig, point: Floats) -> TrotConfig:
    """Return a gait from shares 0..1 of the ranges [P]."""
    values = {
        name: float(low + share * (high - low))
        for (name, (low, high)), share in zip(RANGES.items(), point, strict=True)
    }
    return replace(start, **values)  # type: ignore[arg-type]


def to_point(gait: TrotConfig) -> Floats:
    """Return the shares of the ranges of a gait [P], 0..1."""
    shares = []
    for name, (low, high) in RANGES.items():
        value = getattr(gait, name)
        if value is None:
            value = getattr(gait, name.removeprefix('urgent_'))
        shares.append((value - low) / (high - low))
    return np.clip(np.array(shares), 0.02, 0.98)


class GaitSearch:
    """
    CMA-ES over gaits, seeded and repeatable: a search goes on from the costs of its generations.

    A generation is told by its costs alone, since the candidates follow from the seed and the
    costs before.
    """

    def __init__(self, config: GaitSearchConfig, start: TrotConfig) -> None:
        import cma

        random = np.random.default_rng(config.seed)
        self.config = config
        self._start = start
        self._strategy = cma.CMAEvolutionStrategy(
            to_point(start),
            config.step,
            {
                'randn': lambda *shape: random.standard_normal(shape),
                'seed': np.nan,  # numbers come from `randn`, not from numpy's global state
                'popsize': config.population,
                'bounds': [0.0, 1.0],
                'verbose': -9,
            },
        )
        self.generation = 0
        self._asked: list[Floats] = []

    def ask(self) -> list[TrotConfig]:
        """Return the gaits of the next generation."""
        self._asked = self._strategy.ask()
        return [to_gait(self._start, point) for point in self._asked]

    def tell(self, costs: Sequence[float]) -> None:
        """Take the costs of the gaits that were asked for, W."""
        self._strategy.tell(self._asked, list(costs))
        self.generation += 1

    @property
    def centre(self) -> TrotConfig:
        """Mean of the search distribution, less noisy than the best gait seen."""
        point = self._strategy.boundary_handler.repair(self._strategy.mean)
        return to_gait(self._start, np.clip(np.asarray(point), 0.0, 1.0))


def optimise(
    search: GaitSearch,
    trial: GaitTrial,
    generations: int,
    report: Callable[[int, Sequence[GaitScore], TrotConfig], None],
) -> None:
    """Run generations up to a number; each walks under pushes of its own seed."""
    while search.generation < generations:
        gaits = search.ask()
        scores = trial.run(gaits, 1000 * search.config.seed + search.generation)
        search.tell([score.cost for score in scores])
        report(search.generation, scores, search.centre)
