"""Falls of the scripted trot under pushes, at several rates, with and without cadence adaptation.

Robots walk on rough ground by varying commands and are pushed every 7 s by up to 1 m/s along
each axis, which is what `evaluate` asks of policies; what they sense is true.

    python bench/pushes.py --rates 1.7 1.9 2.1 2.9 [--robots 96] [--seconds 20]
"""

import argparse
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from policy_runner.policies.gait_phase import CADENCE_ADAPTATION
from policy_runner.policies.trot import TROTS
from policy_training.environment.environment import WalkingEnvironment
from policy_training.environment.expert_policy import ExpertPolicy
from policy_training.evaluation.robustness import RobustnessConfig, rough_world
from rich.progress import Progress
from wattwalk_core.console import output, print_table


def falls(
    gait: str,
    rate: float,
    adaptation: tuple[float, ...],
    *,
    robots: int = 96,
    seconds: float = 20.0,
    changes: dict[str, Any] | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> int:
    """Return the falls of robots led by a scripted gait; changes: of the config by name."""
    config = rough_world(RobustnessConfig(robots=robots, seconds=seconds)).with_values(
        changes or {}
    )
    environment = WalkingEnvironment(config)
    environment.age[:] = 0
    own = replace(TROTS[gait], frequency=rate, cadence_adaptation=adaptation)
    expert = ExpertPolicy(environment, [own])
    fallen, steps = 0, round(seconds / config.step_time)
    for step in range(1, steps + 1):
        outcome = environment.step(expert.actions())
        expert.reset(outcome.done)
        fallen += int((outcome.done & ~outcome.timed_out).sum())
        progress(step / steps)
    return fallen


def main() -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument('--gait', default='trot', choices=TROTS)
    parser.add_argument('--rates', nargs='+', type=float, default=[1.7, 1.9, 2.1, 2.9])
    parser.add_argument('--robots', type=int, default=96)
    parser.add_argument('--seconds', type=float, default=20.0)
    options = parser.parse_args()
    if not all(0.8 <= rate <= CADENCE_ADAPTATION[0] for rate in options.rates):
        parser.error(
            f'--rates are {options.rates}; each must lie in 0.8..{CADENCE_ADAPTATION[0]:g} Hz'
        )
    rows: dict[str, list[str]] = {'steady': [], 'adaptive': []}
    with Progress(transient=True) as bar:
        for rate in options.rates:
            for name, adaptation in (('steady', ()), ('adaptive', CADENCE_ADAPTATION)):
                task = bar.add_task(f'{options.gait} at {rate:g} Hz, {name}', total=1.0)
                count = falls(
                    options.gait,
                    rate,
                    adaptation,
                    robots=options.robots,
                    seconds=options.seconds,
                    progress=lambda share, task=task: bar.update(task, completed=share),
                )
                rows[name].append(str(count))
    columns = ('strides per s', *(f'{rate:g}' for rate in options.rates))
    title = f'falls of {options.robots} robots in {options.seconds:g} s'
    print_table(output(), columns, [(name, *counts) for name, counts in rows.items()], title)


if __name__ == '__main__':
    main()
