"""Motions that come with the package, by name; any other is a file."""

from collections.abc import Mapping
from pathlib import Path
from typing import Final

from wattwalk_core.errors import InputError

from drive_bench.motion.file import MotionFile, modes_of, read_yaml

_FOLDER: Final = Path(__file__).parent / 'motions'
MOTIONS: Final = tuple(sorted(path.stem for path in _FOLDER.glob('*.yaml')))
"""Names of the shipped motions."""


def find_motion(wanted: str, mode: str | None = None) -> MotionFile:
    """A shipped motion by name, or a motion file; InputError for one that is not there."""
    if wanted in MOTIONS:
        return MotionFile.load(_FOLDER / f'{wanted}.yaml', mode)
    path = Path(wanted)
    if not path.exists():
        raise InputError(f'no motion {wanted!r}; there are {", ".join(MOTIONS)}, or give a file')
    return MotionFile.load(path, mode)


def listing() -> str:
    """The shipped motions, a line each: name, modes, what it is."""
    lines = []
    for name in MOTIONS:
        content = read_yaml(_FOLDER / f'{name}.yaml')
        assert isinstance(content, Mapping)
        modes = ', '.join(modes_of(content, name)) or 'one way'
        lines.append(f'  {name:10}{modes:28}{content.get("about", "")}')
    return '\n'.join(lines)
