"""Arguments that the commands of training have in common."""

from contextlib import AbstractContextManager, nullcontext

from wattwalk_core.engine.options import Workplace
from wattwalk_core.engine.task_engine import TaskEngine


def engine_of(place: Workplace) -> AbstractContextManager[TaskEngine | None]:
    """Return a context with the engine of a scheduler, or with None where none was given.

    On one machine networks are trained on threads: they share the recordings' signals, which each
    process would hold for itself, and report each epoch.
    """
    if not place.scheduler:
        return nullcontext()
    return TaskEngine(place)
