"""Recordings, models and effects that options name, and the console of tables."""

import argparse
import itertools
import os
import shlex
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any, Final

from power_estimator.effects import Catalogue, load_catalogue
from power_estimator.loader import load_model
from power_recordings.index.store import Stamp
from power_recordings.reading.bag_folder import check_recordings
from rich.console import Console
from wattwalk_core.console import progress
from wattwalk_core.engine.options import Workplace
from wattwalk_core.engine.task_engine import TaskEngine

from power_lab.session import Session

Show = Callable[[str], None]
_WORTH_WORKERS: Final = 100_000_000  # bytes
_WIDE: Final = 140  # columns, for tables that are read in a file


@contextmanager
def opened(options: argparse.Namespace, models: Sequence[str]) -> Iterator[tuple[Session, Show]]:
    """Read the recordings that options name, in worker processes where that saves time.

    Yield the session, and a function that sets the text of progress. InputError for a model that
    cannot be loaded comes before reading. Workers take seconds to start: without --workers or
    --scheduler they are used from 100 MB.
    """
    check_recordings(options.bags)
    catalogue = load_catalogue(options.effects_path)
    check_models(models, catalogue)
    place = Workplace.of(options)
    asked = place.scheduler or place.workers
    small = not asked and sum(Stamp.of(bag).size for bag in options.bags) < _WORTH_WORKERS
    with progress('reading') as show:
        with nullcontext() if small else TaskEngine(place) as engine:
            how = {'engine': engine, 'show': show, **reading_of(options)}
            lab = Session.open(*options.bags, catalogue=catalogue, **how)
        yield lab, show


def check_models(specs: Sequence[str], catalogue: Catalogue) -> None:
    """Raise InputError for a power model that cannot be loaded."""
    for spec in specs:
        load_model(spec, catalogue)


def reading_of(options: argparse.Namespace) -> dict[str, Any]:
    """Return arguments of `load` from options: drives, slow, anyway and without."""
    names = ('drives', 'slow', 'anyway', 'without')
    return {name: getattr(options, name) for name in names}


def next_command(command: str, options: argparse.Namespace, *more: object) -> str:
    """Line with the next command to type, on the same recordings; more: its further words."""
    bags = ['--bag', *options.bags] if command == 'add' else options.bags
    words = [command, *more, *bags] if command == 'add' else [command, *bags, *more]
    for name in ('drives', 'without', 'effects_path'):
        if chosen := getattr(options, name):
            words += [f'--{name.replace("_", "-")}', *chosen]
    words += ['--slow-meter'] if options.slow else []
    words += ['--ignore-unit-conflicts'] if options.anyway else []
    return f'next: ros2 run power_lab {shlex.join(map(str, words))}'


def unused(name: str) -> str:
    """File name that does not exist yet: `better.yaml`, else `better2.yaml` and so on."""
    path = Path(name)
    others = (f'{path.stem}{number}{path.suffix}' for number in itertools.count(2))
    return next(one for one in itertools.chain([name], others) if not Path(one).exists())


def console() -> Console:
    """Console of tables, on stdout; wide where that is no terminal and COLUMNS is not set."""
    given = sys.stdout.isatty() or 'COLUMNS' in os.environ
    return Console(width=None if given else _WIDE, highlight=False, soft_wrap=False)
