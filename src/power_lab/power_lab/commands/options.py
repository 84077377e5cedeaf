"""Recordings, models and effects that options name, and the console of tables."""

import argparse
import itertools
import os
import shlex
import sys
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any, Final

from power_estimator.effects import Catalogue
from power_estimator.loader import load_model
from power_recordings.index.store import Stamp
from rich.console import Console
from wattwalk_core.engine.options import Workplace
from wattwalk_core.engine.task_engine import TaskEngine

_WORTH_WORKERS: Final = 100_000_000  # bytes
_WIDE: Final = 140  # columns, for tables that are read in a file


def reading_engine(
    place: Workplace, bags: Sequence[Path]
) -> AbstractContextManager[TaskEngine | None]:
    """Return what reads recordings side by side, None where it would not be worth it.

    Without --workers or --scheduler it is worth it from 100 MB: workers take seconds to begin.
    """
    asked = place.scheduler or place.workers
    if not asked and sum(Stamp.of(bag).size for bag in bags) < _WORTH_WORKERS:
        return nullcontext()
    return TaskEngine(place)


def check_models(specs: Sequence[str], catalogue: Catalogue) -> None:
    """Raise InputError for a power model that cannot be loaded."""
    for spec in specs:
        load_model(spec, catalogue)


def reading_of(options: argparse.Namespace) -> dict[str, Any]:
    """Choices of drives and doubts, as recordings are read."""
    names = ('drives', 'slow', 'anyway', 'without')
    return {name: getattr(options, name) for name in names}


def next_command(command: str, options: argparse.Namespace, *more: object) -> str:
    """The line that tells what to type next on the same recordings, with the same choices.

    more: what the command takes beside them.
    """
    bags = ['--bag', *options.bags] if command == 'add' else options.bags
    words = [command, *more, *bags] if command == 'add' else [command, *bags, *more]
    for name in ('drives', 'without', 'effects_path'):
        if chosen := getattr(options, name):
            words += [f'--{name.replace("_", "-")}', *chosen]
    words += ['--slow-meter'] if options.slow else []
    words += ['--anyway'] if options.anyway else []
    return f'next: ros2 run power_lab {shlex.join(map(str, words))}'


def unused(name: str) -> str:
    """A name of a file to write that is not there: `better.yaml`, else `better2.yaml` and on."""
    path = Path(name)
    others = (f'{path.stem}{number}{path.suffix}' for number in itertools.count(2))
    return next(one for one in itertools.chain([name], others) if not Path(one).exists())


def console() -> Console:
    """Console of tables, on stdout; wide where that is no terminal and COLUMNS is not set."""
    given = sys.stdout.isatty() or 'COLUMNS' in os.environ
    return Console(width=None if given else _WIDE, highlight=False, soft_wrap=False)
