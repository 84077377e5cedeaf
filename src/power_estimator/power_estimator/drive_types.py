"""Drive types, whose drives share a model, and the name patterns that find them."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Protocol, TypeVar

from wattwalk_core.errors import InputError

_LEG = re.compile(r'^(?:[LR][FHMBR]|[FHMBR][LR]|left|right)_(?P<type>.+)$', re.IGNORECASE)


@dataclass(frozen=True)
class DriveType:
    """Drives that are built and placed alike, found by name patterns such as `*_HAA`."""

    name: str
    patterns: tuple[str, ...]

    def __post_init__(self) -> None:
        if not re.fullmatch(r'[\w.-]{1,64}', self.name):
            raise InputError(f'drive type {self.name!r}: use letters, digits, "_", "." and "-"')
        if not self.patterns:
            raise InputError(f'drive type {self.name!r} has no name pattern; give one like *_HAA')

    def matches(self, drive: str) -> bool:
        """Return whether the drive's name fits one of the patterns."""
        return any(fnmatchcase(drive, pattern) for pattern in self.patterns)


def infer_types(drives: Sequence[str]) -> tuple[DriveType, ...]:
    """Group drives by name: `LF_HAA` and `RH_HAA` are of type HAA, `arm_1` is a type of its own.

    The type is the name without the leg's prefix (LF, RH, FL, left, …), or an ending that several
    drives share (`a_hip`, `b_hip`). Every other drive is a type of its own.
    """
    endings = Counter(drive.partition('_')[2] for drive in drives)
    types: dict[str, list[str]] = {}
    for drive in drives:
        leg = _LEG.match(drive)
        ending = leg['type'] if leg else drive.partition('_')[2]
        if not leg and endings[ending] < 2:
            ending = ''
        name, pattern = (ending, f'*_{ending}') if ending else (drive, drive)
        name = re.sub(r'[^\w.-]', '.', name)
        if pattern not in types.setdefault(name, []):
            types[name].append(pattern)
    return tuple(DriveType(name, tuple(patterns)) for name, patterns in types.items())


def parse_types(texts: Sequence[str]) -> tuple[DriveType, ...]:
    """Parse texts `NAME=PATTERN[,PATTERN…]`; InputError for another form or a name twice."""
    types = []
    for text in texts:
        name, equals, patterns = text.partition('=')
        if not equals or not name or not patterns:
            raise InputError(f'--type {text!r} is not NAME=PATTERN, for example HAA=*_HAA')
        types.append(DriveType(name, tuple(p for p in patterns.split(',') if p)))
    names = [t.name for t in types]
    if len(set(names)) < len(names):
        raise InputError(f'--type: a name is given twice in {", ".join(names)}')
    return tuple(types)


def assign(drives: Sequence[str], types: Sequence[DriveType]) -> dict[str, list[int]]:
    """Return {name of type: columns of its drives}; the first type that matches a drive counts."""
    columns: dict[str, list[int]] = {t.name: [] for t in types}
    for column, drive in enumerate(drives):
        owner = next((t.name for t in types if t.matches(drive)), None)
        if owner is not None:
            columns[owner].append(column)
    return columns


class OfType(Protocol):
    """Protocol of what belongs to a drive type, such as a network."""

    @property
    def type(self) -> DriveType:
        """Drive type that it belongs to."""


Item = TypeVar('Item', bound=OfType)


def owners(drives: Sequence[str], items: Sequence[Item]) -> list[Item | None]:
    """Return for each drive the first item whose type matches its name, None without one."""
    return [next((i for i in items if i.type.matches(drive)), None) for drive in drives]
