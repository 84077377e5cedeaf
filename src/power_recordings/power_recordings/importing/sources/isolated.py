"""Arrays of files that native code reads, in a process of its own.

Damaged files make the readers of MAT files and HEBI logs crash; there it costs no more than the
file. Run as a module, this loads the file and hands the arrays over in a .npz file.
"""

import json
import resource
import subprocess
import sys
import tempfile
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.errors import InputError

_MEMORY: Final = 3 << 30  # bytes
_PATIENCE: Final = 120.0  # s
_NAMES: Final = 'names'


def load_isolated(reader: str, path: Path, kind: str) -> dict[str, NDArray[Any]]:
    """Return the arrays that `load(path)` of sibling module `reader` returns, by name.

    kind: the kind of file, for the InputError that is raised for a damaged one.
    """
    with tempfile.TemporaryDirectory(prefix='wattwalk') as folder:
        out = Path(folder) / 'arrays.npz'
        command = [sys.executable, '-m', __name__, reader, str(path), str(out)]
        try:
            done = subprocess.run(
                command, capture_output=True, text=True, timeout=_PATIENCE, check=False
            )
        except subprocess.TimeoutExpired:
            raise InputError(f'{path}: not a readable {kind}: no end in {_PATIENCE} s') from None
        if done.returncode == 2:
            raise InputError(done.stderr.strip())
        if done.returncode:
            raise InputError(f'{path}: not a readable {kind}: its reader crashed')
        with np.load(out, allow_pickle=False) as content:
            names = json.loads(str(content[_NAMES]))
            return {name: content[f'array{i}'] for i, name in enumerate(names)}


def _main(reader: str, path: str, out: str) -> int:
    resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    module = import_module(f'power_recordings.importing.sources.{reader}')
    try:
        found: dict[str, NDArray[Any]] = module.load(Path(path))
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    numbered: dict[str, Any] = {f'array{i}': array for i, array in enumerate(found.values())}
    with Path(out).open('wb') as file:
        np.savez(file, names=np.array(json.dumps(list(found))), **numbered)
    return 0


if __name__ == '__main__':
    raise SystemExit(_main(*sys.argv[1:]))
