"""Logs that the page's file chooser hands over, kept in the session's folder."""

import shutil
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Final

from wattwalk_core.errors import InputError
from wattwalk_core.files import reason

from power_workbench.files.logs import ENDINGS

LARGEST_LOG: Final = 2 << 30
"""Bytes of a log that is handed over; larger ones are named with their folder."""
_ROOM: Final = 1 << 30  # bytes that stay free on the disk
_FOLDER: Final = 'logs'


async def keep_log(
    folder: Path, name: str, length: int, chunks: AsyncIterator[bytes]
) -> dict[str, str]:
    """Write a log of length bytes below a session's folder, whole or not at all.

    InputError for a name that is no log's, and where the disk has no room.
    """
    if Path(name).name != name or name.startswith('.') or not name.isprintable():
        raise InputError(f'{name!r} is no name of a file')
    if not name.lower().endswith(ENDINGS):
        raise InputError(f'{name}: expected a log ({", ".join(ENDINGS)})')
    path = folder / _FOLDER / name
    part = path.with_name(f'.{name}.part')
    try:
        if shutil.disk_usage(folder).free - length < _ROOM:
            raise InputError(f'{name}: the disk of {folder} has no room for {length / 1e6:.0f} MB')
        path.parent.mkdir(exist_ok=True)
        with part.open('wb') as file:
            async for chunk in chunks:
                file.write(chunk)
        part.replace(path)
    except OSError as error:
        raise InputError(f'cannot write {path}: {reason(error)}') from error
    finally:
        part.unlink(missing_ok=True)
    return {'file': str(path)}
