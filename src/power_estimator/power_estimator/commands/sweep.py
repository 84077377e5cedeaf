"""`ros2 run power_estimator sweep`: the plateau over hidden units and history, with its cost."""

import argparse
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wattwalk_core.command import command

from power_estimator.training.run_folder import TABLE, NetworkRunFolder
from power_estimator.training.trainer_config import TrainerConfig

if TYPE_CHECKING:
    from rich.console import Console

    from power_estimator.training.cross_validation import Job
    from power_estimator.training.sweep import Result, SweepPoint
    from power_estimator.training.trainer import Trainer

PICTURE = 'sweep.png'
HIDDEN = (8, 16, 32, 64, 100, 150)
HISTORY = (0.02, 0.05, 0.1, 0.2, 0.3, 0.5)


@command
def main(args: Sequence[str] | None = None) -> int:
    """Entry point."""
    options = _parser().parse_args(args)

    from rich.console import Console

    from power_estimator import recordings
    from power_estimator.drive_types import infer_types, parse_types
    from power_estimator.evaluation.tables import TrainingBars, terminal
    from power_estimator.training.sweep import Sweep, points
    from power_estimator.training.sweep_figure import draw_sweep

    progress = Console(stderr=True)
    wanted = points(options.hidden, options.history)
    training = TrainerConfig(epochs=options.epochs, seed=options.seed)
    with progress.status('reading and aligning'):
        given = recordings.training_set(options.bags, options.drives)
    types = parse_types(options.type) if options.type else infer_types(given.data.names)
    sweep = Sweep(given, types, wanted, training, folds=options.folds, segments=options.segments)
    networks = [job.name for job in sweep.validation(wanted[0]).jobs]
    jobs = [f'{point.name} {name}' for point in wanted for name in networks]
    folder = NetworkRunFolder(options.output)
    about: dict[str, Any] = {
        'types': {t.name: list(t.patterns) for t in types},
        'training': asdict(training),
        'folds': options.folds,
        'segments': options.segments,
        'longest_history': max(p.network().history for p in wanted),
    }
    cards = [asdict(recording) for recording in given.recordings]
    (folder.resume if options.resume else folder.start)(about, cards)
    try:
        with TrainingBars(progress, jobs, training.epochs) as bars:

            def show(point: 'SweepPoint', job: 'Job', trainer: 'Trainer') -> None:
                last = trainer.history[-1]
                name = f'{point.name} {job.name}'
                bars.show(name, last.number, last.loss, last.r2, trainer.done)

            results = list(sweep.run(options.output, show, options.workers))
    except KeyboardInterrupt:
        print(f'stopped; {options.output} goes on with the same command and --resume')
        raise
    folder.save_json(TABLE, {'points': [result.content() for result in results]})
    draw_sweep(options.output / PICTURE, results, dark=options.dark)
    folder.finish()
    _print(terminal(), results)
    print(f'picture: {options.output / PICTURE}; table: {options.output / TABLE}')
    return 0


def _print(console: 'Console', results: Sequence['Result']) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    from power_estimator.training.sweep import CHOSEN

    kinds = list(dict.fromkeys(kind for result in results for kind in result.r2))
    view = Table(title='R² on held-out data', title_justify='left', box=SIMPLE_HEAD)
    for name in ('units', 'history', *(f'{kind} R²' for kind in kinds), 'µs/sample'):
        view.add_column(name, justify='right', no_wrap=True)
    for result in results:
        history = result.point.history
        chosen = result.point.hidden == CHOSEN.hidden and history in (None, CHOSEN.history)
        view.add_row(
            str(result.point.hidden),
            'carried' if history is None else f'{history / CHOSEN.rate:g} s',
            *(_score(result, kind) for kind in kinds),
            f'{result.us_per_sample:.0f}',
            style='bold' if chosen else None,
        )
    console.print(view)


def _score(result: 'Result', kind: str) -> str:
    mean, spread = result.r2.get(kind, (float('nan'), 0.0))
    return f'{mean:.3f} ±{spread:.3f}' if spread else f'{mean:.3f}'


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='ros2 run power_estimator sweep',
        description='Train networks of several sizes (with carried state) and, at 100 units, of '
        'several histories (windowed), test them on the same held-out data, and draw where more '
        'no longer helps. Costs are µs per sample of twelve drives on this machine.',
        epilog='example: ros2 run power_estimator sweep bags/paper/* -o runs/sweep '
        '--hidden 16 32 64 100 150 --history 0.05 0.1 0.2 0.3 0.5',
    )
    add = parser.add_argument
    add('bags', nargs='+', type=Path, metavar='BAG', help='recordings with measured drives')
    add('-o', '--output', type=Path, required=True, metavar='RUN', help='new run folder')
    add('--hidden', nargs='+', type=int, default=HIDDEN, metavar='N', help='hidden units')
    add('--history', nargs='+', type=float, default=HISTORY, metavar='S', help='seconds')
    add('--folds', type=int, default=1, help='folds of the cross-validation (1)')
    add('--segments', type=int, default=6, help='segments that are each split 80/10/10 (6)')
    add('--drives', nargs='+', default=[], metavar='NAME', help='names or patterns, as *_KFE')
    add('--type', action='append', metavar='NAME=PATTERN', help='a drive type; default by name')
    add('--epochs', type=int, default=12, help='at most, per network (12)')
    add('--seed', type=int, default=0, help='the same seed gives the same networks')
    add('--workers', type=int, default=1, help='networks at a time (1)')
    add('--resume', action='store_true', help='go on with a sweep that was stopped, or add points')
    add('--dark', action='store_true', help='picture on a dark ground')
    return parser
