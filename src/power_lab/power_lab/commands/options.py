"""Arguments that commands of the lab have in common, and their console."""

import argparse
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Final

from wattwalk_core.command import command_parser
from wattwalk_core.engine.options import Workplace
from wattwalk_core.errors import InputError

if TYPE_CHECKING:
    from power_estimator.effects import Catalogue
    from power_estimator.effects.fit.design import Active
    from rich.console import Console
    from wattwalk_core.engine.task_engine import TaskEngine

_WORTH_WORKERS: Final = 100_000_000  # bytes


def parser(
    name: str, description: str, epilog: str, *, effects: bool = True, package: str = 'power_lab'
) -> argparse.ArgumentParser:
    """A parser with the arguments that every command has."""
    made = command_parser(f'{package} {name}', description, epilog)
    if effects:
        made.add_argument(
            '--effects-path',
            nargs='+',
            action='extend',
            default=[],
            type=Path,
            metavar='FILE.py',
            help='your own effects; these files are run, so name only what you trust',
        )
    return made


def add_bags(made: argparse.ArgumentParser) -> None:
    """Recordings and drives."""
    made.add_argument('bags', nargs='+', type=Path, metavar='BAG', help='recordings')
    made.add_argument(
        '--drives',
        nargs='+',
        default=[],
        metavar='NAME',
        help='only these drives',
    )
    add_doubts(made)


def add_doubts(made: argparse.ArgumentParser) -> None:
    """Recordings that are refused unless one insists."""
    made.add_argument(
        '--slow',
        action='store_true',
        help='take power that changes less than 25 times a second: judge energy over windows',
    )
    made.add_argument(
        '--anyway',
        action='store_true',
        help='take signals whose units or signs contradict each other',
    )


def reading_engine(
    place: Workplace, bags: Sequence[Path]
) -> 'AbstractContextManager[TaskEngine | None]':
    """
    Return what reads recordings side by side, None where it would not be worth it.

    Without --workers or --scheduler it is worth it from 100 MB: workers take seconds to begin.
    """
    from power_recordings.index.stamp import Stamp
    from wattwalk_core.engine.task_engine import TaskEngine

    asked = place.scheduler or place.workers
    if not asked and sum(Stamp.of(bag).size for bag in bags) < _WORTH_WORKERS:
        return nullcontext()
    return TaskEngine(place)


def add_outputs(made: argparse.ArgumentParser, *, report: bool = True) -> None:
    """Arguments for files of results."""
    made.add_argument('--json', type=Path, metavar='FILE', help='write the result as JSON')
    if report:
        made.add_argument('--report', type=Path, metavar='FILE.html', help='write a page to read')


def check_bags(paths: Sequence[Path]) -> None:
    """Raise InputError where there is no recording."""
    from power_recordings.reading.bag_folder import check_recordings

    check_recordings(paths)


def check_models(specs: Sequence[str], catalogue: 'Catalogue') -> None:
    """Raise InputError for a power model that cannot be loaded."""
    from power_estimator.loader import load_model

    for spec in specs:
        load_model(spec, catalogue)


def catalogue_of(options: argparse.Namespace) -> 'Catalogue':
    """Shipped effects and the user's own."""
    from power_estimator.effects import load_catalogue

    return load_catalogue(options.effects_path)


def parse_effects(text: Sequence[str], catalogue: 'Catalogue') -> list['Active']:
    """
    Names apart or joined by commas: `shaft,copper_loss,idle`.

    Errors of the measurement may be named as well; every fit has them anyway. InputError for an
    unknown or repeated name.
    """
    from power_estimator.effects.fit.design import Active

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


def console() -> 'Console':
    """Console of tables, on stdout."""
    from rich.console import Console

    return Console(highlight=False, soft_wrap=False)
