"""`ros2 run power_estimator sweep`: the plateau over hidden units and history, with its cost."""

import argparse
from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

from wattwalk_core.command import command, command_parser
from wattwalk_core.console import output, print_table
from wattwalk_core.engine.options import Workplace, add_workplace

from power_estimator.commands.options import add_cross_validation, add_training, engine_of
from power_estimator.training.run_folder import TABLE, NetworkRunFolder
from power_estimator.training.trainer_config import TrainerConfig

if TYPE_CHECKING:
    from power_estimator.training.sweep import Result

PICTURE = 'sweep.png'
HIDDEN = (8, 16, 32, 64, 100, 150)
HISTORY = (0.02, 0.05, 0.1, 0.2, 0.3, 0.5)


@command
def main(args: Sequence[str] | None = None) -> int:
    """Entry point."""
    options = _parser().parse_args(args)
    place = Workplace.of(options)

    from power_recordings.reading.bag_folder import check_recordings

    check_recordings(options.bags)

    from rich.console import Console

    from power_estimator import recordings
    from power_estimator.drive_types import infer_types, parse_types
    from power_estimator.evaluation.tables import TrainingBars
    from power_estimator.training.sweep import Sweep, points
    from power_estimator.training.sweep_figure import draw_sweep

    progress = Console(stderr=True)
    wanted = points(options.hidden, options.history)
    training = TrainerConfig(epochs=options.epochs, seed=options.seed)
    with progress.status('reading and aligning'):
        given = recordings.training_set(options.bags, options.drives)
    types = parse_types(options.type) if options.type else infer_types(given.data.names)
    sweep = Sweep(given, types, wanted, training, folds=options.folds, segments=options.segments)
    networks = [job.name for job in sweep.jobs]
    jobs = [f'{point.name} {name}' for point in wanted for name in networks]
    folder = NetworkRunFolder(options.output)
    about = {
        'types': {t.name: list(t.patterns) for t in types},
        'training': asdict(training),
        'folds': options.folds,
        'segments': options.segments,
        'longest_history': max(p.network().history for p in wanted),
    }
    folder.open(about, given.recordings, resume=options.resume)
    with (
        engine_of(place) as engine,
        TrainingBars(progress, jobs, training.epochs, folder.path) as bars,
    ):
        workers = place.processes(len(networks))
        results = list(sweep.run(options.output, bars.show, workers, engine))
    folder.save_json(TABLE, {'points': [result.content() for result in results]})
    draw_sweep(options.output / PICTURE, results, dark=options.dark)
    folder.finish()
    _print(results)
    print(f'picture: {options.output / PICTURE}; table: {options.output / TABLE}')
    return 0


def _print(results: Sequence['Result']) -> None:
    from rich.text import Text

    from power_estimator.training.sweep import CHOSEN

    kinds = list(dict.fromkeys(kind for result in results for kind in result.r2))
    rows = []
    for result in results:
        history = result.point.history
        chosen = result.point.hidden == CHOSEN.hidden and history in (None, CHOSEN.history)
        cells = (
            str(result.point.hidden),
            'carried' if history is None else f'{history / CHOSEN.rate:g} s',
            *(_score(result, kind) for kind in kinds),
            f'{result.us_per_sample:.0f}',
        )
        rows.append([Text(cell, style='bold' if chosen else '') for cell in cells])
    columns = ('units', 'history', *(f'{kind} R²' for kind in kinds), 'µs/sample')
    print_table(output(140), columns, rows, 'R² on held-out data')


def _score(result: 'Result', kind: str) -> str:
    mean, spread = result.r2.get(kind, (float('nan'), 0.0))
    return f'{mean:.3f} ±{spread:.3f}' if spread else f'{mean:.3f}'


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(
        'power_estimator sweep',
        'Train networks of several sizes (with carried state) and, at 100 units, of '
        'several histories (windowed), test them on the same held-out data, and draw where more '
        'no longer helps. Costs are µs per sample of twelve drives on this machine.',
        'example: ros2 run power_estimator sweep bags/paper/* -o runs/sweep '
        '--hidden 16 32 64 100 150 --history 0.05 0.1 0.2 0.3 0.5',
    )
    add_training(parser, epochs=12)
    add_workplace(parser, 'networks')
    add_cross_validation(parser, folds=1)
    add = parser.add_argument
    add('--hidden', nargs='+', type=int, default=HIDDEN, metavar='N', help='hidden units')
    add('--history', nargs='+', type=float, default=HISTORY, metavar='S', help='seconds')
    return parser
