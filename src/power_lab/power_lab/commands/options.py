"""Recordings, models and effects that options name, and the console of tables."""

from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Final

from power_estimator.effects import Catalogue
from power_estimator.effects.fit.design import Active
from power_estimator.loader import load_model
from power_recordings.index.stamp import Stamp
from rich.console import Console
from wattwalk_core.engine.options import Workplace
from wattwalk_core.engine.task_engine import TaskEngine
from wattwalk_core.errors import InputError

_WORTH_WORKERS: Final = 100_000_000  # bytes


def reading_engine(
    place: Workplace, bags: Sequence[Path]
) -> AbstractContextManager[TaskEngine | None]:
    """
    Return what reads recordings side by side, None where it would not be worth it.

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


def parse_effects(text: Sequence[str], catalogue: Catalogue) -> list[Active]:
    """
    Names apart or joined by commas: `shaft,copper_loss,idle`.

    Errors of the measurement may be named as well; every fit has them anyway. InputError for an
    unknown or repeated name.
    """
    names = [name.strip() for part in text for name in part.split(',') if name.strip()]
    if not names:
        raise InputError('--effects is empty; for example shaft,copper_loss,idle')
    if len(set(names)) < len(names):
        raise InputError(f'--effects names an effect twice: {",".join(names)}')
    actives = []
    for name in names:
        effect = catalogue.get_known(name, '--effects')
        if effect.kind == 'physics':
            actives.append(Active.of(effect))
    if not actives:
        raise InputError(
            f'--effects: {", ".join(names)} are errors of the measurement, which every fit has '
            'anyway; name effects of the drive'
        )
    return actives


def console() -> Console:
    """Console of tables, on stdout."""
    return Console(highlight=False, soft_wrap=False)
