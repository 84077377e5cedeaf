"""Recordings, models and effects that options name, and the console of tables."""

import argparse
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


def console() -> Console:
    """Console of tables, on stdout."""
    return Console(highlight=False, soft_wrap=False)
