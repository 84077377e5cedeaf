"""Progress, tables and result files of commands."""

import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wattwalk_core.errors import InputError
from wattwalk_core.files import write_whole

if TYPE_CHECKING:
    from rich.console import Console  # slow to import, and parsers import this file
    from rich.progress import Progress
    from rich.text import Text

_EACH = 10.0  # s between lines of progress in a file
PICTURES = ('.png', '.svg', '.pdf')


@contextmanager
def progress(text: str) -> Iterator[Callable[[str], None]]:
    """Show a text and the time since the start on stderr, within a `with` block.

    Yields a function that replaces the text. Where stderr is no terminal, a line is printed every
    ten seconds.
    """
    from rich.console import Console  # slow to import, and parsers import this file
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn('{task.description}'), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as shown:
        task, begun, last = shown.add_task(text), time.monotonic(), 0.0

        def show(description: str) -> None:
            nonlocal last
            shown.update(task, description=description)
            seconds = time.monotonic() - begun
            if seconds - last >= _EACH and not sys.stderr.isatty():
                last = seconds
                print(f'{seconds:.0f} s: {description}', file=sys.stderr, flush=True)

        yield show


def counting_bar(unit: str = '', *, digits: int = 0, elapsed: bool = False) -> 'Progress':
    """Return a bar on stderr that counts `N of M unit`, with the time left, or elapsed."""
    from rich.console import Console  # slow to import, and parsers import this file
    from rich.progress import (
        BarColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    count = f'{{task.completed:.{digits}f}} of {{task.total:.{digits}f}} {unit}'.rstrip()
    columns = (TextColumn('{task.description}'), BarColumn(), TextColumn(count))
    time_shown = TimeElapsedColumn() if elapsed else TimeRemainingColumn()
    return Progress(*columns, time_shown, console=Console(stderr=True))


def output(width: int = 100) -> 'Console':
    """Return a console on stdout, `width` columns wide where that is no terminal."""
    from rich.console import Console  # slow to import, and parsers import this file

    size = None if sys.stdout.isatty() else width
    return Console(width=size, highlight=False, markup=False)


def print_table(
    console: 'Console',
    columns: Sequence[str],
    rows: Sequence[Sequence['str | Text']],
    title: str | None = None,
) -> None:
    """Print a table: the first column is text, which may wrap, the others are set to the right."""
    from rich.box import SIMPLE_HEAD  # slow to import, and parsers import this file
    from rich.table import Table

    table = Table(title=title, title_justify='left', box=SIMPLE_HEAD)
    table.add_column(columns[0], overflow='fold')
    for name in columns[1:]:
        table.add_column(name, justify='right', no_wrap=True)
    for row in rows:
        table.add_row(*row)
    console.print(table)


def write_json(path: Path | None, content: Any) -> None:
    """Write plain values as JSON; do nothing where path is None.

    InputError if it cannot be written, ValueError for NaN.
    """
    if path is None:
        return
    text = json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False)
    write_whole(path, text + '\n')


def finite(content: Any) -> Any:
    """Return a copy of plain values with None for NaN and infinity, which JSON has not."""
    if isinstance(content, dict):
        return {key: finite(item) for key, item in content.items()}
    if isinstance(content, list | tuple):
        return [finite(item) for item in content]
    return None if isinstance(content, float) and not isfinite(content) else content


def ending(option: str, *suffixes: str) -> Callable[[str], Path]:
    """Return an argparse type: a Path that ends in one of the suffixes, InputError for others."""

    def path(text: str) -> Path:
        if Path(text).suffix not in suffixes:
            raise InputError(f'{option} {text!r}: end it in {", ".join(suffixes)}')
        return Path(text)

    return path
