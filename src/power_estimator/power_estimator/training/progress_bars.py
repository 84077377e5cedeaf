"""Progress of a training on the terminal."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

from power_estimator.training.trainer import Trainer


@contextmanager
def training_bars(
    console: Console, jobs: Sequence[str], epochs: int, run: Path
) -> Iterator[Callable[[str, Trainer], None]]:
    """Show a bar over all epochs of all networks, and one for each that is being trained.

    Yields a function that shows the last epoch of a job, with its loss and R². run: folder that
    Ctrl-C names, as the training can be resumed there.
    """
    columns = (
        TextColumn('{task.description}'),
        BarColumn(),
        TextColumn('{task.completed:.0f}/{task.total:.0f}'),
        TextColumn('{task.fields[state]}'),
        TimeElapsedColumn(),
    )
    reached = dict.fromkeys(jobs, 0)
    tasks: dict[str, TaskID] = {}
    try:
        with Progress(*columns, console=console, transient=True) as progress:
            whole = progress.add_task('training', total=len(jobs) * epochs, state='')

            def show(job: str, trainer: Trainer) -> None:
                last = trainer.history[-1]
                number, state = last.number, f'loss {last.loss:.4f}  R² {last.r2:.4f}'
                if trainer.done:
                    if job in tasks:
                        progress.remove_task(tasks.pop(job))
                    number = epochs
                elif job not in tasks:
                    tasks[job] = progress.add_task(job, total=epochs, state=state)
                if job in tasks:
                    progress.update(tasks[job], completed=number, state=state)
                progress.update(whole, advance=number - reached[job], state=state)
                reached[job] = number

            yield show
    except KeyboardInterrupt:
        print(f'stopped; {run} goes on with the same command and --resume')
        raise
