"""Arguments that the commands of training have in common."""

import argparse
import os
from pathlib import Path

from power_estimator.training.trainer_config import TrainerConfig

WORKERS = min(8, os.cpu_count() or 1)


def add_training(
    parser: argparse.ArgumentParser,
    *,
    epochs: int = TrainerConfig.epochs,
    workers: int = WORKERS,
) -> None:
    """Add recordings, the run folder and the settings of a training."""
    add = parser.add_argument
    add('bags', nargs='+', type=Path, metavar='BAG', help='recordings with measured drives')
    add('-o', '--output', type=Path, required=True, metavar='RUN', help='new run folder')
    add('--drives', nargs='+', default=[], metavar='NAME', help='names or patterns, as *_KFE')
    add('--epochs', type=int, default=epochs, help=f'at most, per network ({epochs})')
    add('--seed', type=int, default=0, help='the same seed gives the same networks')
    add('--workers', type=int, default=workers, help=f'networks at a time ({workers})')
    add('--resume', action='store_true', help='continue a run that was stopped')


def add_cross_validation(parser: argparse.ArgumentParser, *, folds: int) -> None:
    """Add drive types, the split of the data and the style of figures."""
    add = parser.add_argument
    add('--folds', type=int, default=folds, help=f'folds of the cross-validation ({folds})')
    add('--segments', type=int, default=6, help='segments that are each split 80/10/10 (6)')
    add('--type', action='append', metavar='NAME=PATTERN', help='a drive type; default by name')
    add('--dark', action='store_true', help='figures on a dark ground')
