"""Files read within limits and written whole or not at all; errors of the disk in words."""

import errno
import os
import shutil
import stat
from pathlib import Path

from wattwalk_core.errors import InputError

_ROOM = 64 << 20  # bytes
_ADVICE = {
    errno.ENOSPC: 'the disk is full: free some space or choose another disk',
    errno.EDQUOT: 'the disk quota is used up: free some space or choose another disk',
    errno.EFBIG: 'the file may not grow further (ulimit -f or the file system)',
    errno.EACCES: 'no permission to write there: choose another folder',
    errno.EPERM: 'no permission to write there: choose another folder',
    errno.EROFS: 'the file system is read-only: choose another folder',
    errno.ENOENT: 'there is no such folder: create it first',
    errno.ENOTDIR: 'part of the path is a file: choose another folder',
}


class RecordingError(InputError):
    """A recording cannot be written on; the message says what was kept and what was lost."""


def read_bytes(path: Path, what: str, limit: int) -> bytes:
    """
    Read a regular file of at most `limit` bytes.

    Raises InputError, which calls the file `what`, for one that is absent, no regular file (a
    pipe, a device) or larger.
    """
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            raise InputError(f'{what} {path}: not a regular file')
        with path.open('rb') as file:
            data = file.read(limit + 1 if status.st_size <= limit else 0)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise InputError(f'cannot read {what} {path}: {reason}') from error
    if max(len(data), status.st_size) > limit:
        raise InputError(f'{what} {path}: larger than {limit >> 10} KiB')
    return data


def advice(error: OSError) -> str:
    """Return the reason of an error of the disk, and a remedy."""
    return _ADVICE.get(error.errno or 0, error.strerror or str(error))


def write_whole(path: Path, content: str | bytes) -> None:
    """Write under a temporary name, then rename it to path; RecordingError if it cannot."""
    data = content.encode() if isinstance(content, str) else content
    temporary = path.with_name(f'.{path.name}.{os.getpid()}')
    try:
        with temporary.open('wb') as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise RecordingError(f'cannot write {path}: {advice(error)}') from error


def check_room(path: Path) -> None:
    """InputError if the disk that path will be on has less than 64 MiB left."""
    folder = next(p for p in path.absolute().parents if p.exists())
    free = shutil.disk_usage(folder).free
    if free < _ROOM:
        raise InputError(
            f'only {free / 1e6:.0f} MB are free for {path}: free some space or choose another disk'
        )
