"""Hashes of code and files, by which it is known whether a result would come out the same."""

import hashlib
from collections.abc import Iterable
from functools import cache
from importlib.util import find_spec
from pathlib import Path


@cache
def code_fingerprint(*packages: str) -> str:
    """Return a hash of the source files of packages or modules, by dotted name."""
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
    """Return a hash of the bytes of files, and of all files in folders."""
    digest = hashlib.sha256()
    for path in paths:
        for file in sorted(path.rglob('*')) if path.is_dir() else [path]:
            if file.is_file():
                digest.update(file.name.encode())
                with file.open('rb') as stream:
                    digest.update(hashlib.file_digest(stream, 'sha256').digest())
    return digest.hexdigest()
