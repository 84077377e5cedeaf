"""Search of the scripted gait that draws least power, by CMA-ES.

Each candidate walks all tasks, calm and pushed. Its cost is the mean power of the drives on calm
robots plus penalties in watts for tracking errors and for falls of pushed robots: a gait is a
reference for policies only if it stays on its feet.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from typing import Annotated, Final

import cma
import numpy as np
from policy_runner.policies.gait_phase import CADENCE_ADAPTATION
from policy_runner.policies.trot import TrotConfig
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError
from wattwalk_core.schema import Quantity, schema

from policy_training.config import TrialConfig
from policy_training.environment.environment import WalkingEnvironment
from policy_training.environment.expert_policy import ExpertPolicy
from policy_training.evaluation.task_trial import TaskTrial, TrialScore
from policy_training.evaluation.tasks import TASKS, Task

_FALL: Final = 300.0  # W, if all pushed robots fall

RANGES: Final[Mapping[str, tuple[float, float]]] = {
    'frequency': (1.0, 2.4),
    'frequency_per_speed': (0.0, 1.2),
    'stance_speed': (0.6, 1.2),
    'duty': (0.52, 0.7),
    'height': (0.48, 0.61),
    'swing_height': (0.015, 0.09),
    'foot_x': (0.26, 0.44),
    'foot_y': (0.13, 0.30),
    'damping': (1.0, 4.5),
    'urgent_duty': (0.5, 0.65),
    'urgent_height': (0.48, 0.60),
    'urgent_swing_height': (0.04, 0.14),
    'urgent_foot_x': (0.30, 0.46),
    'urgent_foot_y': (0.22, 0.36),
}
"""What is searched, lowest and highest."""


@schema
class GaitSearchConfig:
    """Settings of a search."""

    seed: Annotated[int, Quantity(0, 2**31 - 1)] = 1
    population: Annotated[int, Quantity(4, 256, '', 'gaits in a generation')] = 14
    trial: TrialConfig = field(default_factory=TrialConfig)
    step: Annotated[float, Quantity(0.01, 1.0, '', 'initial, share of the ranges')] = 0.15
    task: str = ''  # the only task that is walked; empty for all

    def __post_init__(self) -> None:
        if self.task and self.task not in {task.name for task in TASKS}:
            known = ', '.join(task.name for task in TASKS)
            raise InputError(f'task is {self.task!r}; it must be one of {known}')

    @property
    def tasks(self) -> tuple[Task, ...]:
        """Tasks that are walked."""
        return tuple(task for task in TASKS if self.task in ('', task.name))

    @property
    def searched(self) -> tuple[str, ...]:
        """Names of what is searched: at a single speed nothing depends on speed."""
        return tuple(name for name in RANGES if not self.task or name != 'frequency_per_speed')


def start_of(gait: TrotConfig) -> TrotConfig:
    """Return a gait that may hurry and that reaches the commands of the tasks."""
    return replace(gait, cadence_adaptation=CADENCE_ADAPTATION, max_forward=1.2, max_yaw=1.2)


def to_gait(
    start: TrotConfig, point: Floats, searched: Sequence[str] = tuple(RANGES)
) -> TrotConfig:
    """Return a gait from shares 0..1 of the ranges searched [P]."""
    values = {}
    for name, share in zip(searched, point, strict=True):
        low, high = RANGES[name]
        values[name] = float(low + share * (high - low))
    return replace(start, **values)  # type: ignore[arg-type]


def to_point(gait: TrotConfig, searched: Sequence[str] = tuple(RANGES)) -> Floats:
    """Return the shares of the ranges of a gait [P], 0..1."""
    shares = []
    for name in searched:
        low, high = RANGES[name]
        value = getattr(gait, name)
        if value is None:
            value = getattr(gait, name.removeprefix('urgent_'))
        shares.append((value - low) / (high - low))
    return np.clip(np.array(shares), 0.02, 0.98)


class GaitSearch:
    """CMA-ES over gaits, seeded, repeatable: a search goes on from the costs of its generations.

    A generation is told by its costs alone, since the candidates follow from the seed and the
    costs before.
    """

    def __init__(self, config: GaitSearchConfig, start: TrotConfig) -> None:

        random = np.random.default_rng(config.seed)
        self.config = config
        self._start = start
        self._strategy = cma.CMAEvolutionStrategy(
            to_point(start, config.searched),
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
        return [to_gait(self._start, point, self.config.searched) for point in self._asked]

    def tell(self, costs: Sequence[float]) -> None:
        """Take the costs of the gaits that were asked for, W."""
        self._strategy.tell(self._asked, list(costs))
        self.generation += 1

    @property
    def centre(self) -> TrotConfig:
        """Mean of the search distribution, less noisy than the best gait seen."""
        point = self._strategy.boundary_handler.repair(self._strategy.mean)
        return to_gait(self._start, np.clip(np.asarray(point), 0.0, 1.0), self.config.searched)


def try_gaits(trial: TaskTrial, gaits: Sequence[TrotConfig], seed: int) -> list[TrialScore]:
    """Return the scores of gaits that walk side by side; as many as the trial has controllers."""

    def walkers(environment: WalkingEnvironment) -> ExpertPolicy:
        return ExpertPolicy(environment, [g for g in gaits for _ in range(trial.robots_each)])

    return trial.run(walkers, seed)


class GaitTrial:
    """Trial of gaits side by side: a calm robot as built for each task, and pushed ones."""

    def __init__(self, config: GaitSearchConfig, gaits: int, threads: int = 0) -> None:
        calm = replace(config.trial, calm=1, pushed=0)
        self._calm = TaskTrial(calm, gaits, threads, tasks=config.tasks, as_built=True)
        self._pushed = TaskTrial(config.trial, gaits, threads, tasks=config.tasks)

    def scores(self, gaits: Sequence[TrotConfig], seed: int) -> list[TrialScore]:
        """Return power and tracking of calm robots, and falls of those with the seed's pushes.

        Costs have an eighth of the others' on top: a gait must suit robots that differ, too.
        """
        calm = try_gaits(self._calm, gaits, 0)
        pushed = try_gaits(self._pushed, gaits, seed)
        return [
            replace(own, cost=own.cost + other.cost / 8.0 + _FALL * other.falls, falls=other.falls)
            for own, other in zip(calm, pushed, strict=True)
        ]


def optimise(
    search: GaitSearch,
    trial: GaitTrial,
    generations: int,
    report: Callable[[int, Sequence[TrialScore], TrotConfig], None],
) -> None:
    """Run generations up to a number; each walks under pushes of its own seed."""
    while search.generation < generations:
        gaits = search.ask()
        scores = trial.scores(gaits, 1000 * search.config.seed + search.generation)
        search.tell([score.cost for score in scores])
        report(search.generation, scores, search.centre)
