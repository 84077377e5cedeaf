"""Tables and progress on the terminal."""

import sys
from collections.abc import Mapping, Sequence
from types import TracebackType
from typing import Any, Self

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Table


def terminal() -> Console:
    """Return a console on stdout, of a fixed width where that is no terminal."""
    return Console(width=None if sys.stdout.isatty() else 140)


def print_table(
    console: Console, table: Mapping[str, Any], title: str, group: str = 'types'
) -> None:
    """Print R² ± spread per drive type (or `drives`) and of the sum; best in bold."""
    models = table['models']
    keys = list(dict.fromkeys(key for m in models for key in m[group]))
    view = Table(title=title, title_justify='left', box=SIMPLE_HEAD)
    view.add_column('model', no_wrap=True)
    columns = [[m[group].get(key) for m in models] for key in keys]
    totals = [m['total'] for m in models]
    for key in keys:
        view.add_column(f'{key} R²', justify='right', no_wrap=True)
    if any(totals):
        columns.append(totals)
        view.add_column('sum R²', justify='right', no_wrap=True)
    wide = console.width >= 110
    for name in ('RMSE [W]', 'energy error [%]') if wide else ():
        view.add_column(name, justify='right', no_wrap=True)
    for row, model in enumerate(models):
        each = [s for s in model[group].values() if s]
        view.add_row(
            model['name'],
            *(_r2(column, row) for column in columns),
            *([_join(each, 'rmse_w', 1), _join(each, 'energy_error', 100)] if wide else []),
        )
    console.print(view)


def _join(scores: Sequence[Mapping[str, float]], key: str, factor: float) -> str:
    return ' '.join(f'{factor * score[key]:.1f}' for score in scores)


def _r2(column: Sequence[Mapping[str, float] | None], row: int) -> str:
    score = column[row]
    if score is None or score.get('r2') is None:
        return '–'
    text = f'{score["r2"]:.3f}'
    if score.get('r2_std'):
        text += f' ±{score["r2_std"]:.3f}'
    best = max(s['r2'] for s in column if s is not None and s.get('r2') is not None)
    return f'[bold]{text}[/bold]' if score['r2'] == best else text


class TrainingBars:
    """A bar over all epochs of all networks, and one for each network that is being trained."""

    def __init__(self, console: Console, jobs: Sequence[str], epochs: int) -> None:
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

    def show(self, job: str, number: int, loss: float, r2: float, done: bool) -> None:
        """Show that a job has reached an epoch, and its loss and R²."""
        state = f'loss {loss:.4f}  R² {r2:.4f}'
        if done:
            if job in self._tasks:
                self._progress.remove_task(self._tasks.pop(job))
            number = self._epochs
        elif job not in self._tasks:
            self._tasks[job] = self._progress.add_task(job, total=self._epochs, state=state)
        if job in self._tasks:
            self._progress.update(self._tasks[job], completed=number, state=state)
        self._progress.update(self._all, advance=number - self._reached[job], state=state)
        self._reached[job] = number
