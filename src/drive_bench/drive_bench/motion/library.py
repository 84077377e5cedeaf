"""Shipped motions by name, and motion files."""

from pathlib import Path
from typing import Final

from wattwalk_core.errors import InputError
from wattwalk_core.yaml_file import read_yaml

from drive_bench.motion.file import MotionFile

_FOLDER: Final = Path(__file__).parent / 'motions'
MOTIONS: Final = tuple(sorted(path.stem for path in _FOLDER.glob('*.yaml')))
"""Names of the shipped motions."""


def find_motion(wanted: str, mode: str | None = None) -> MotionFile:
    """Return a shipped motion or that of a file; InputError for one that is not there."""
    if wanted in MOTIONS:
        return MotionFile.load(_FOLDER / f'{wanted}.yaml', mode)
    path = Path(wanted)
    if not path.exists():
        raise InputError(f'no motion {wanted!r}; there are {", ".join(MOTIONS)}, or give a file')
    return MotionFile.load(path, mode)


def listing() -> str:
    """Return a line for each shipped motion: name, modes, description."""
    lines = []
    for name in MOTIONS:
        content = read_yaml(_FOLDER / f'{name}.yaml', 'motion')
        modes = ', '.join(content.get('modes', {})) or 'one way'
        lines.append(f'  {name:10}{modes:28}{content.get("about", "")}')
    return '\n'.join(lines)
