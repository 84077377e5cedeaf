"""Progress of a training on the terminal."""

from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

from power_estimator.training.trainer import Trainer


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

    def show(self, job: str, trainer: Trainer) -> None:
        """Show the last epoch of a job, with its loss and R²."""
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
