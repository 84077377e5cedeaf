"""Tables and progress on the terminal."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from statistics import fmean, pstdev
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.text import Text
from wattwalk_core.console import output, print_table

from power_estimator.judge.result import JudgedModel
from power_estimator.scores import Score

if TYPE_CHECKING:
    from power_estimator.training.trainer import Trainer


WIDTH = 140  # of tables where stdout is no terminal


def table(folds: Sequence[Sequence[JudgedModel]]) -> dict[str, Any]:
    """
    Average over folds in the form of the benchmark's JSON.

    {`models`: [{`name`, `held_out`, `drives` {name: {`r2`, `r2_std`, `rmse_w`, …}}, `types`,
    `total`, `supply`}]}. `r2_std` is the spread between folds, of one fold that over stretches.
    """
    common = [name for name in (m.name for m in folds[0]) if all(_named(f, name) for f in folds)]
    models = []
    for name in common:
        of = [judged for fold in folds for judged in _named(fold, name)]
        models.append(
            {
                'name': name,
                'held_out': of[0].held_out,
                'drives': _each([judged.drives for judged in of]),
                'types': _each([judged.types for judged in of]),
                'total': _mean([judged.total for judged in of if judged.total]),
                'supply': _mean([judged.supply.score for judged in of if judged.supply]),
            }
        )
    return {'models': models}


def _named(fold: Sequence[JudgedModel], name: str) -> list[JudgedModel]:
    return [judged for judged in fold if judged.name == name]


def _each(folds: Sequence[Mapping[str, Score]]) -> dict[str, Any]:
    keys = dict.fromkeys(key for fold in folds for key in fold)
    return {key: _mean([fold[key] for fold in folds if key in fold]) for key in keys}


def _mean(scores: Sequence[Score]) -> dict[str, float | None] | None:
    scores = [score for score in scores if score.samples]
    if not scores:
        return None
    rows = [asdict(score) for score in scores]
    means = {key: fmean(float(row[key]) for row in rows) for key in rows[0] if key != 'samples'}
    mean = Score(samples=round(fmean(score.samples for score in scores)), **means)
    r2s = [score.r2 for score in scores]
    if len(r2s) > 1:
        mean = replace(mean, r2_std=pstdev(r2s) if np.isfinite(r2s).all() else float('nan'))
    return mean.json()


def print_scores(table: Mapping[str, Any], title: str) -> None:
    """Print R² ± spread per drive type and of the sum; best in bold."""
    console, models = output(WIDTH), table['models']
    keys = list(dict.fromkeys(key for m in models for key in m['types']))
    columns = {f'{key} R²': [m['types'].get(key) for m in models] for key in keys}
    if any(m['total'] for m in models):
        columns['sum R²'] = [m['total'] for m in models]
    wide = console.width >= 110
    errors = {'RMSE [W]': ('rmse_w', 1), 'energy error [%]': ('energy_error', 100)} if wide else {}
    rows = [
        [
            model['name'],
            *(_r2(column, row) for column in columns.values()),
            *(_join([s for s in model['types'].values() if s], *each) for each in errors.values()),
        ]
        for row, model in enumerate(models)
    ]
    print_table(console, ('model', *columns, *errors), rows, title)


def _join(scores: Sequence[Mapping[str, float]], key: str, factor: float) -> str:
    return ' '.join(f'{factor * score[key]:.1f}' for score in scores)


def _r2(column: Sequence[Mapping[str, float] | None], row: int) -> Text:
    score = column[row]
    if score is None or score.get('r2') is None:
        return Text('–')
    spread = f' ±{score["r2_std"]:.3f}' if score.get('r2_std') else ''
    best = max(s['r2'] for s in column if s is not None and s.get('r2') is not None)
    return Text(f'{score["r2"]:.3f}{spread}', style='bold' if score['r2'] == best else '')


class TrainingBars:
    """A bar over all epochs of all networks, and one for each network that is being trained."""

    def __init__(self, console: Console, jobs: Sequence[str], epochs: int, run: Path) -> None:
        """run: folder that Ctrl-C names, as the training can be resumed there."""
        self._run = run
        self._epochs = epochs
        self._reached = dict.fromkeys(jobs, 0)
        self._tasks: dict[str, TaskID] = {}
        self._progress = Progress(
            TextColumn('{task.description}'),
            BarColumn(),
            TextColumn('{task.completed:.0f}/{task.total:.0f}'),
            TextColumn('{task.fields[state]}'),
            TimeElapsedColumn(),
            console=console,
            transient=True,
        )
        self._all = self._progress.add_task('training', total=len(jobs) * epochs, state='')

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._progress.stop()
        if kind is not None and issubclass(kind, KeyboardInterrupt):
            print(f'stopped; {self._run} goes on with the same command and --resume')

    def show(self, job: str, trainer: 'Trainer') -> None:
        """Show that a job has reached an epoch, and its loss and R²."""
        last = trainer.history[-1]
        number, state = last.number, f'loss {last.loss:.4f}  R² {last.r2:.4f}'
        if trainer.done:
            if job in self._tasks:
                self._progress.remove_task(self._tasks.pop(job))
            number = self._epochs
        elif job not in self._tasks:
            self._tasks[job] = self._progress.add_task(job, total=self._epochs, state=state)
        if job in self._tasks:
            self._progress.update(self._tasks[job], completed=number, state=state)
        self._progress.update(self._all, advance=number - self._reached[job], state=state)
        self._reached[job] = number
