"""
Search of the scripted gait that draws least power, by CMA-ES.

Each candidate walks all tasks, calm and pushed. Its cost is the mean power of the drives on calm
robots plus penalties in watts for tracking errors and for falls of pushed robots: a gait is a
reference for policies only if it stays on its feet.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from typing import Annotated, Final

import numpy as np
from numpy.typing import NDArray
from policy_runner.policies.gait_phase import CADENCE_ADAPTATION
from policy_runner.policies.trot import TrotConfig
from wattwalk_core.schema import Quantity, schema

from policy_training.config import TrialConfig
from policy_training.environment.environment import WalkingEnvironment
from policy_training.environment.expert_policy import ExpertPolicy
from policy_training.evaluation.task_trial import TaskTrial, TrialScore

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


@schema
class GaitSearchConfig:
    """Settings of a search."""

    seed: Annotated[int, Quantity(0, 2**31 - 1)] = 1
    population: Annotated[int, Quantity(4, 256, '', 'gaits in a generation')] = 14
    trial: TrialConfig = field(default_factory=TrialConfig)
    step: Annotated[float, Quantity(0.01, 1.0, '', 'initial, share of the ranges')] = 0.15


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


def try_gaits(trial: TaskTrial, gaits: Sequence[TrotConfig], seed: int) -> list[TrialScore]:
    """Return the scores of gaits that walk side by side; as many as the trial has controllers."""

    def walkers(environment: WalkingEnvironment) -> ExpertPolicy:
        return ExpertPolicy(environment, [g for g in gaits for _ in range(trial.robots_each)])

    return trial.run(walkers, seed)


def optimise(
    search: GaitSearch,
    trial: TaskTrial,
    generations: int,
    report: Callable[[int, Sequence[TrialScore], TrotConfig], None],
) -> None:
    """Run generations up to a number; each walks under pushes of its own seed."""
    while search.generation < generations:
        gaits = search.ask()
        scores = try_gaits(trial, gaits, 1000 * search.config.seed + search.generation)
        search.tell([score.cost for score in scores])
        report(search.generation, scores, search.centre)
