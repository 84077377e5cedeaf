"""Files read within limits and written whole or not at all; errors of the disk in words."""

import errno
import hashlib
import os
import shutil
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from functools import cache
from importlib.util import find_spec
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
    errno.EISDIR: 'it is a folder: give the name of a file',
    errno.ENOENT: 'there is no such folder: create it first',
    errno.ENOTDIR: 'part of the path is a file: choose another folder',
}


_WAITING: ContextVar[dict[Path, Path] | None] = ContextVar('waiting', default=None)
"""Temporary files and what they are renamed to at the end of `together`."""


class RecordingError(InputError):
    """Error for a file that cannot be written; the message states what was kept and lost."""


def read_bytes(path: Path, what: str, limit: int) -> bytes:
    """Read a regular file of at most `limit` bytes.

    Raises InputError, which calls the file `what`, for one that is absent, no regular file (a
    pipe, a device) or larger.
    """
    size = regular_size(path, what)
    try:
        with path.open('rb') as file:
            data = file.read(limit + 1 if size <= limit else 0)
    except OSError as error:
        raise InputError(f'cannot read {what} {path}: {reason(error)}') from error
    if max(len(data), size) > limit:
        raise InputError(f'{what} {path}: larger than {limit >> 10} KiB')
    return data


def regular_size(path: Path, what: str) -> int:
    """Return the bytes of a regular file; InputError, which calls it `what`, for anything else."""
    try:
        status = path.stat()
    except (OSError, ValueError) as error:
        raise InputError(f'cannot read {what} {path}: {reason(error)}') from error
    if not stat.S_ISREG(status.st_mode):
        raise InputError(f'{what} {path}: not a regular file')
    return status.st_size


def reason(error: OSError | ValueError) -> str:
    """Return the text of an error in opening a path, without its number and path."""
    return (error.strerror if isinstance(error, OSError) else None) or str(error)


def advice(error: OSError) -> str:
    """Return the reason of an error in writing and, where one is known, a remedy."""
    return _ADVICE.get(error.errno or 0, error.strerror or str(error))


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file, text as UTF-8, whole or not at all; RecordingError if it cannot be written.

    Within `together` it appears at the end of that block.
    """
    data = content.encode() if isinstance(content, str) else content
    temporary = path.with_name(f'.{path.name}.{os.getpid()}')
    waiting = _WAITING.get()
    try:
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, 'it is a folder')
        with temporary.open('wb') as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        if waiting is None:
            temporary.replace(path)
        else:
            waiting[temporary] = path
    except OSError as error:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise RecordingError(f'cannot write {path}: {advice(error)}') from error


@contextmanager
def together() -> Iterator[None]:
    """Let all files that `write_whole` writes within a `with` block appear at its end, or none."""
    waiting: dict[Path, Path] = {}
    token = _WAITING.set(waiting)
    try:
        yield
        for temporary, path in waiting.items():
            temporary.replace(path)
    finally:
        _WAITING.reset(token)
        for temporary in waiting:
            temporary.unlink(missing_ok=True)


def check_room(path: Path) -> None:
    """Raise InputError if the disk that path will be on has less than 64 MiB left."""
    folder = next(p for p in path.absolute().parents if p.exists())
    free = shutil.disk_usage(folder).free
    if free < _ROOM:
        raise InputError(
            f'only {free / 1e6:.0f} MB are free for {path}: free some space or choose another disk'
        )


@cache
def code_fingerprint(*packages: str) -> str:
    """Return the SHA-256 in hex of the Python sources of packages or modules (dotted names)."""
    digest = hashlib.sha256()
    for name in packages:
        spec = find_spec(name)
        origin = Path(spec.origin or '') if spec is not None else Path()
        files = sorted(origin.parent.rglob('*.py')) if origin.stem == '__init__' else [origin]
        for file in files:
            digest.update(f'{name} {file.relative_to(origin.parent)} '.encode())
            digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()


def file_fingerprint(paths: Iterable[Path]) -> str:
    """Return the SHA-256 in hex of the names and bytes of files, and of all files in folders."""
    digest = hashlib.sha256()
    for path in paths:
        for file in sorted(path.rglob('*')) if path.is_dir() else [path]:
            if file.is_file():
                digest.update(file.name.encode())
                with file.open('rb') as stream:
                    digest.update(hashlib.file_digest(stream, 'sha256').digest())
    return digest.hexdigest()
