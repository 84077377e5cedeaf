"""Arguments that the commands of training have in common."""

import argparse
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

from wattwalk_core.engine.options import Workplace

from power_estimator.training.trainer_config import TrainerConfig

if TYPE_CHECKING:
    from wattwalk_core.engine.task_engine import TaskEngine


def engine_of(place: Workplace) -> 'AbstractContextManager[TaskEngine | None]':
    """
    Return the engine of a scheduler, None without one.

    On one machine networks are trained on threads: they share the recordings' signals, which each
    process would hold for itself, and tell of each epoch.
    """
    if not place.scheduler:
        return nullcontext()
    from wattwalk_core.engine.task_engine import TaskEngine

    return TaskEngine(place)


def add_training(parser: argparse.ArgumentParser, *, epochs: int = TrainerConfig.epochs) -> None:
    """Add recordings, the run folder and the settings of a training."""
    add = parser.add_argument
    add('bags', nargs='+', type=Path, metavar='BAG', help='recordings with measured drives')
    add('-o', '--output', type=Path, required=True, metavar='RUN', help='new run folder')
    add('--drives', nargs='+', default=[], metavar='NAME', help='names or patterns, as *_KFE')
    add('--epochs', type=int, default=epochs, help=f'at most, per network ({epochs})')
    add('--seed', type=int, default=0, help='the same seed gives the same networks')
    add('--resume', action='store_true', help='continue a run that was stopped')


def add_cross_validation(parser: argparse.ArgumentParser, *, folds: int) -> None:
    """Add drive types, the split of the data and the style of figures."""
    add = parser.add_argument
    add('--folds', type=int, default=folds, help=f'folds of the cross-validation ({folds})')
    add('--segments', type=int, default=6, help='segments that are each split 80/10/10 (6)')
    add('--type', action='append', metavar='NAME=PATTERN', help='a drive type; default by name')
    add('--dark', action='store_true', help='figures on a dark ground')
