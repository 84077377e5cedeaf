"""What all commands of the lab share: arguments, progress, output."""

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from power_estimator.effects import Catalogue, load_catalogue
from power_estimator.effects.fit.design import Active
from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from wattwalk_core.errors import InputError
from wattwalk_core.files import write_whole


def parser(
    name: str, description: str, epilog: str, *, effects: bool = True
) -> argparse.ArgumentParser:
    """A parser with the arguments that every command has."""
    made = argparse.ArgumentParser(
        prog=name,
        description=description,
        epilog=epilog,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
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


def add_outputs(made: argparse.ArgumentParser, *, report: bool = True) -> None:
    """Where to write."""
    made.add_argument('--json', type=Path, metavar='FILE', help='write the result as JSON')
    if report:
        made.add_argument('--report', type=Path, metavar='FILE.html', help='write a page to read')


def catalogue_of(options: argparse.Namespace) -> Catalogue:
    """Shipped effects and the user's own."""
    return load_catalogue(options.effects_path)


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


def write_json(path: Path | None, content: Mapping[str, Any]) -> None:
    """Write it if a path is given."""
    if path is not None:
        text = json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False)
        write_whole(path, text + '\n')


def console() -> Console:
    """Where tables go."""
    return Console(highlight=False, soft_wrap=False)


def waiting() -> Progress:
    """A line on stderr that says what is being done."""
    return Progress(
        SpinnerColumn(),
        TextColumn('{task.description}'),
        TimeElapsedColumn(),
        console=Console(stderr=True),
        transient=True,
    )


def require_suffix(path: Path | None, suffix: str, option: str) -> None:
    """InputError if an output file has another ending."""
    if path is not None and path.suffix != suffix:
        raise InputError(f'{option} {str(path)!r}: end it in {suffix}')
