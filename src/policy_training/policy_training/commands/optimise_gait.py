"""`ros2 run policy_training optimise_gait`: the scripted gait that draws least power."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from wattwalk_core.command import command, command_parser
from wattwalk_core.console import output, print_table
from wattwalk_core.errors import InputError

if TYPE_CHECKING:
    from policy_runner.policies.trot_gait import TrotConfig

    from policy_training.evaluation.task_trial import TrialScore

_EPILOG = """\
RUN/gait.yaml is the gait so far, for `imitation.gait` of a training; Ctrl-C and kill lose one
generation at most.

examples:
  ros2 run policy_training optimise_gait -o runs/gait
  ros2 run policy_training optimise_gait -o runs/gait --resume --generations 150
  ros2 run policy_training train --config baseline --set imitation.gait=runs/gait -o runs/economy

A gait for each task draws less than one for all (give each of the four its search):
  ros2 run policy_training optimise_gait --task forward -o runs/forward
  ros2 run policy_training optimise_gait --join runs/forward runs/fast runs/turn -o runs/gait
"""


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(
        'policy_training optimise_gait',
        'Search the scripted gait that draws least power over all tasks, by CMA-ES, with pushed '
        'robots in the objective.',
        _EPILOG,
    )
    add = parser.add_argument
    add('-o', '--output', type=Path, required=True, metavar='RUN', help='folder of the search')
    add('--resume', action='store_true', help='go on with the search in that folder')
    add('--gait', default='trot_even', help='gait to start from, by name (trot_even)')
    add('--generations', type=int, default=100, metavar='N', help='in all (100)')
    add('--population', type=int, metavar='N', help='gaits in a generation (14)')
    add('--task', help='search the gait of one task alone: forward, fast, turn or sideways')
    add(
        '--join',
        nargs='+',
        type=Path,
        metavar='RUN',
        help='write the gaits of searches of a task each as one that follows the command',
    )
    add('--seed', type=int, help='of everything random (1)')
    add('--threads', type=int, default=0, metavar='N', help='of the simulation; 0: one per core')
    return parser


@command
def main(args: Sequence[str] | None = None) -> int:
    """Entry point."""
    options = _parser().parse_args(args)
    if options.generations < 1 or options.threads < 0:
        raise InputError('--generations must be 1 or more, --threads not negative')

    from policy_runner.policies.trot_gait import TROTS
    from rich.console import Console
    from wattwalk_core.schema import parse

    from policy_training.learning.gait_files import GaitSearchFolder
    from policy_training.learning.gait_search import (
        GaitSearch,
        GaitSearchConfig,
        GaitTrial,
        optimise,
        start_of,
    )

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

    def report(generation: int, scores: 'Sequence[TrialScore]', centre: 'TrotConfig') -> None:
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
    from wattwalk_core.files import write_whole
    from wattwalk_core.yaml_file import dump_yaml

    from policy_training.learning.gait_files import GAIT, join_searches

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


def _print(scores: 'Sequence[TrialScore]', base: str) -> None:
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
