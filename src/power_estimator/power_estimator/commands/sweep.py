"""`ros2 run power_estimator sweep`: the plateau over hidden units and history, with its cost."""

import argparse
from collections.abc import Sequence
from dataclasses import asdict

from power_recordings.reading.bag_folder import check_recordings
from rich.console import Console
from rich.text import Text
from wattwalk_core.console import output, print_table
from wattwalk_core.engine.options import Workplace

from power_estimator import recordings
from power_estimator.drive_types import infer_types, parse_types
from power_estimator.judge.recordings import load
from power_estimator.training.on_workers import engine_of
from power_estimator.training.progress_bars import training_bars
from power_estimator.training.run_folder import TABLE, NetworkRunFolder
from power_estimator.training.sweep import CHOSEN, Result, Sweep, points
from power_estimator.training.sweep_figure import draw_sweep
from power_estimator.training.trainer_config import TrainerConfig

PICTURE = 'sweep.png'


def run(options: argparse.Namespace) -> None:
    place = Workplace.of(options)
    check_recordings(options.bags)
    progress = Console(stderr=True)
    wanted = points(options.hidden, options.history)
    training = TrainerConfig(epochs=options.epochs, seed=options.seed)
    with progress.status('reading and aligning'):
        given = recordings.training_set(options.bags, options.drives)
        judged_on = load(options.bags, options.drives, anyway=True)
    types = parse_types(options.type) if options.type else infer_types(given.data.names)
    sweep = Sweep(
        given,
        types,
        wanted,
        training,
        recordings=judged_on,
        folds=options.folds,
        segments=options.segments,
    )
    networks = [job.name for job in sweep.jobs]
    jobs = [f'{point.name} {name}' for point in wanted for name in networks]
    folder = NetworkRunFolder(options.output)
    about = {
        'types': {t.name: list(t.patterns) for t in types},
        'training': asdict(training),
        'folds': options.folds,
        'segments': options.segments,
        'scored': 'by the judge',  # points that were scored otherwise do not go on
        'longest_history': max(p.network().history for p in wanted),
    }
    folder.open(about, given.recordings, resume=options.resume)
    with (
        engine_of(place) as engine,
        training_bars(progress, jobs, training.epochs, folder.path) as show,
    ):
        workers = place.processes(len(networks))
        results = list(sweep.run(options.output, show, workers, engine))
    folder.save_json(TABLE, {'points': [result.content() for result in results]})
    draw_sweep(options.output / PICTURE, results, dark=options.dark)
    folder.finish()
    _print(results)
    print(f'picture: {options.output / PICTURE}; table: {options.output / TABLE}')


def _print(results: Sequence[Result]) -> None:
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


def _score(result: Result, kind: str) -> str:
    mean, spread = result.r2.get(kind, (float('nan'), 0.0))
    return f'{mean:.3f} ±{spread:.3f}' if spread else f'{mean:.3f}'
