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

    from policy_training.evaluation.task_trial import TaskTrial
    from policy_training.learning.gait_files import GaitSearchFolder
    from policy_training.learning.gait_search import (
        GaitSearch,
        GaitSearchConfig,
        optimise,
        start_of,
        try_gaits,
    )

    folder = GaitSearchFolder(options.output)
    given = {'population': options.population, 'seed': options.seed}
    changes = {key: value for key, value in given.items() if value is not None}
    if options.resume:
        if changes:
            raise InputError('--resume keeps --population and --seed as they were; leave them out')
        config, base = folder.resume()
    else:
        config, base = parse(GaitSearchConfig, changes, 'option'), options.gait
    if base not in TROTS:
        raise InputError(f'no gait {base!r}; there are {", ".join(TROTS)}')
    search = GaitSearch(config, start_of(TROTS[base]))
    trial = TaskTrial(config.trial, config.population, options.threads)
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
    final = TaskTrial(config.trial, 2, options.threads)
    both = [start_of(TROTS[base]), search.centre]
    _print(try_gaits(final, both, 10**6 + config.seed), base)
    print(f'wrote {folder.path}/gait.yaml')
    print(f'ros2 run policy_training train --set imitation.gait={folder.path} -o runs/economy')
    return 0


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
