"""`ros2 run power_estimator sweep`: the plateau over hidden units and history, with its cost."""

import argparse
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from power_recordings.reading.bag_folder import check_recordings
from rich.console import Console
from rich.text import Text
from wattwalk_core.console import output, print_table
from wattwalk_core.engine.options import Workplace
from wattwalk_core.figures import OTHERS, save_figure, style

from power_estimator import recordings
from power_estimator.drive_types import infer_types, parse_types
from power_estimator.judge.recordings import load
from power_estimator.training.on_workers import engine_of
from power_estimator.training.progress_bars import training_bars
from power_estimator.training.run_folder import TABLE, NetworkRunFolder
from power_estimator.training.sweep import CHOSEN, Result, Sweep, points
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
    _draw(options.output / PICTURE, results, dark=options.dark)
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


def _draw(path: Path, results: Sequence[Result], *, dark: bool = False) -> None:
    """Draw R² above and µs per sample below, over units at left and history at right.

    results: by ascending units and by ascending history, as `Sweep.run` yields them.
    """
    carried = [r for r in results if r.point.history is None]
    windows = [r for r in results if r.point.history is not None]
    whole = next((r for r in carried if r.point.hidden == CHOSEN.hidden), None)
    units = [float(r.point.hidden) for r in carried]
    seconds = [(r.point.history or 0) / CHOSEN.rate for r in windows]
    second, title = CHOSEN.history / CHOSEN.rate, f'windows of history, {CHOSEN.hidden} units'
    columns = (
        ('carried state', 'hidden units', units, carried, CHOSEN.hidden, None),
        (title, 'history [s]', seconds, windows, second, whole),
    )
    with style(dark) as ink:
        figure = Figure(figsize=(9, 6), layout='constrained')
        axes = figure.subplots(2, 2, sharex='col', sharey='row', height_ratios=(3, 1.2))
        for (top, bottom), column in zip(axes.T, columns, strict=True):
            title, label, x, found, chosen, line = column
            _draw_scores(top, x, found, line)
            bottom.plot(x, [r.us_per_sample for r in found], 'o-', color=ink, ms=4)
            bottom.set(xscale='log', yscale='log', xlabel=label)
            bottom.set_xticks(x, [f'{v:g}' for v in x])
            bottom.minorticks_off()
            for axis in (top, bottom):
                axis.axvline(chosen, color=ink, lw=0.8, ls=(0, (4, 3)))
            top.set_title(title, loc='left', fontsize=11)
        axes[0, 0].set_ylabel('R² on held-out data')
        axes[1, 0].set_ylabel('µs per sample\nof 12 drives')
        axes[0, 0].legend(loc='lower right', frameon=False)
        save_figure(figure, path)


def _draw_scores(
    axis: Axes, x: Sequence[float], found: Sequence[Result], line: Result | None
) -> None:
    kinds = list(dict.fromkeys(kind for result in found for kind in result.r2))
    lowest = 1.0
    for colour, kind in zip(OTHERS * (1 + len(kinds) // len(OTHERS)), kinds, strict=False):
        mean = np.array([r.r2.get(kind, (np.nan, 0))[0] for r in found])
        spread = np.array([r.r2.get(kind, (np.nan, 0))[1] for r in found])
        bars = np.where(spread > 0, spread, np.nan)
        axis.errorbar(x, mean, bars, fmt='o-', ms=4, capsize=2, color=colour, label=kind)
        if line is not None and kind in line.r2:
            axis.axhline(line.r2[kind][0], color=colour, lw=1, ls=':')
        lowest = min(lowest, float(np.nanmin(mean - spread)))
    low, high = axis.get_ylim()
    axis.set_ylim(max(min(low, lowest), 0.0), max(high, 1.0))
