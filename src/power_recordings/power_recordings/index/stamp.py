"""Identity of a recording's files by path, size and date, without reading them."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from wattwalk_core.errors import InputError
from wattwalk_core.files import reason

from power_recordings.card import FILE

_WHOLE = (1 << 63) - 1  # that SQLite's numbers go to


@dataclass(frozen=True)
class Stamp:
    """
    Path, bytes and dates of a recording's files and its card.

    size and changed are sums over the files, so that a change of any of them is seen; changed is
    of their dates in ns, modulo 2⁶³.
    """

    path: str
    size: int
    changed: int

    @classmethod
    def of(cls, path: Path) -> Self:
        """
        Stamp a bag folder or file; InputError where there is none.

        Take it before the files are read: what is written to them after that is a change.
        """
        try:
            # Path.resolve raises RuntimeError for links in a circle; this raises OSError.
            own = Path(os.path.realpath(path, strict=True))
            if own.is_dir():
                with os.scandir(own) as entries:
                    found = [entry.stat() for entry in entries if entry.is_file()]
            else:
                beside = (own, own.parent / FILE)
                found = [file.stat() for file in beside if file.exists()]
        except (OSError, ValueError) as error:
            raise InputError(f'there is no recording {path}: {reason(error)}') from None
        size = sum(status.st_size for status in found)
        changed = sum(status.st_mtime_ns for status in found) & _WHOLE
        return cls(str(own), size, changed)
