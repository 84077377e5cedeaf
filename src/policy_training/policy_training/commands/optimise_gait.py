"""`ros2 run policy_training optimise_gait`: the scripted gait that draws least power."""

import argparse
from collections.abc import Sequence

from policy_runner.policies.trot_gait import TROTS, TrotConfig
from rich.console import Console
from wattwalk_core.console import output, print_table
from wattwalk_core.errors import InputError
from wattwalk_core.files import write_whole
from wattwalk_core.schema import parse
from wattwalk_core.yaml_file import dump_yaml

from policy_training.evaluation.task_trial import TrialScore
from policy_training.learning.gait_files import GAIT, GaitSearchFolder, join_searches
from policy_training.learning.gait_search import (
    GaitSearch,
    GaitSearchConfig,
    GaitTrial,
    optimise,
    start_of,
)


def run(options: argparse.Namespace) -> int:
    folder = GaitSearchFolder(options.output)
    if options.join:
        _join(options)
        return 0
    given = {'population': options.population, 'seed': options.seed, 'task': options.task}
    changes = {key: value for key, value in given.items() if value is not None}
    if options.resume:
        if changes:
            raise InputError(
                '--resume keeps --population, --seed and --task as they were; leave them out'
            )
        config, base = folder.resume()
    else:
        config, base = parse(GaitSearchConfig, changes, 'option'), options.gait
    if base not in TROTS:
        raise InputError(f'no gait {base!r}; there are {", ".join(TROTS)}')
    search = GaitSearch(config, start_of(TROTS[base]))
    trial = GaitTrial(config, config.population, options.threads)
    if options.resume:
        folder.replay(search)
    else:
        folder.start(config, base)
    console = Console(stderr=True)

    def report(generation: int, scores: Sequence[TrialScore], centre: TrotConfig) -> None:
        folder.add(generation, scores, centre, base)
        best = min(scores, key=lambda score: score.cost)
        console.print(
            f'generation {generation} of {options.generations}: best {best.cost:.0f} W with '
            f'penalties, {best.power:.0f} W, {best.falls:.0%} of the pushed robots fell'
        )

    optimise(search, trial, options.generations, report)
    final = GaitTrial(config, 2, options.threads)
    both = [start_of(TROTS[base]), search.centre]
    _print(final.scores(both, 10**6 + config.seed), base)
    print(f'wrote {folder.path}/gait.yaml')
    print(f'ros2 run policy_training train --set imitation.gait={folder.path} -o runs/economy')
    return 0


def _join(options: argparse.Namespace) -> None:
    content = join_searches(options.join)
    path = options.output / GAIT
    if path.exists():
        raise InputError(f'{path} is there already; give another folder')
    options.output.mkdir(parents=True, exist_ok=True)
    write_whole(path, dump_yaml(content))
    clock = content['values']
    print(
        f'wrote {path}: strides of {clock["frequency"]:.2f} Hz, and '
        f'{clock["frequency_per_speed"]:.2f} Hz more for each m/s'
    )


def _print(scores: Sequence[TrialScore], base: str) -> None:
    tasks = list(scores[0].by_task)
    columns = (
        'gait',
        *(f'{task} W' for task in tasks),
        'knees W',
        'falls',
        'm/s off',
        'rad/s off',
    )
    rows = [
        (
            name,
            *(f'{watts:.0f}' for watts in score.by_task.values()),
            f'{score.knees:.0f}',
            f'{score.falls:.0%}',
            f'{score.speed_error:.2f}',
            f'{score.yaw_error:.2f}',
        )
        for name, score in zip((base, 'found'), scores, strict=True)
    ]
    title = 'twelve drives of calm robots; falls of pushed ones; velocity errors of the worst task'
    print_table(output(140), columns, rows, title)
