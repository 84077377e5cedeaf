"""Views and signals of recordings by their stamps: a cache that may be deleted."""

import hashlib
import json
import os
import shutil
import struct
import time
import zlib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from power_estimator.judge.recordings import Loaded, spans_of
from power_recordings.alignment.dataset import AlignedDataset
from power_recordings.index.store import Stamp, usual_path
from power_recordings.reading.reader import Recording
from wattwalk_core.errors import InputError
from wattwalk_core.files import code_fingerprint

from power_workbench.sessions.source import Source
from power_workbench.views.view import PowerView, StateWords

_HEAD = struct.Struct('<IQ')  # checksum of all that follows, bytes of the header
_ALIGNED = 64  # bytes
_KINDS = ('<f4', '<f8', '<i4', '<i8', '|u1')


class DamagedFileError(ValueError):
    """Error for a file of arrays that is torn, of another format, or fails its checksum."""


@dataclass(frozen=True)
class ArrayFile:
    """Arrays by name and further content of JSON, `about`, to be kept in one file."""

    arrays: Mapping[str, NDArray[Any]]
    about: Mapping[str, Any]

    def write(self, path: Path) -> int:
        """Write under a temporary name, then rename it to path; return the file's size in bytes.

        OSError leaves nothing behind; TypeError for arrays other than 32- and 64-bit numbers and
        bytes. It is not forced to the disk: a power cut may tear it, which its checksum tells.
        """
        rows, place = {}, 0
        parts: list[bytes | memoryview] = []
        for name, values in self.arrays.items():
            kind = values.dtype.newbyteorder('<').str
            if kind not in _KINDS:
                raise TypeError(f'{name}: {kind} is none of {", ".join(_KINDS)}')
            rows[name] = (kind, list(values.shape), place)
            whole = np.ascontiguousarray(values, kind).reshape(-1).view(np.uint8)
            parts += [whole.data, bytes(-len(whole) % _ALIGNED)]
            place += len(whole) + len(parts[-1])
        header = json.dumps({'arrays': rows, 'about': self.about}).encode()
        header += b' ' * (-(_HEAD.size + len(header)) % _ALIGNED)
        checksum = zlib.crc32(header, zlib.crc32(_HEAD.pack(0, len(header))[4:]))
        for part in parts:
            checksum = zlib.crc32(part, checksum)
        temporary = path.with_name(f'.{path.name}.{os.getpid()}')
        try:
            with temporary.open('wb') as file:
                file.writelines([_HEAD.pack(checksum, len(header)), header, *parts])
                size = file.tell()
            temporary.replace(path)
        except OSError:
            with suppress(OSError):
                temporary.unlink(missing_ok=True)
            raise
        return size

    @classmethod
    def read(cls, path: Path) -> 'ArrayFile':
        """Map a file into memory; OSError where there is none, DamagedFileError for another."""
        if path.stat().st_size < _HEAD.size:
            raise DamagedFileError(f'{path} holds no arrays')
        mapped = np.memmap(path, np.uint8, 'r')
        checksum, length = _HEAD.unpack_from(mapped.data)
        if zlib.crc32(mapped[4:].data) != checksum:
            raise DamagedFileError(f'{path} is torn')
        content = json.loads(bytes(mapped[_HEAD.size : _HEAD.size + length]))
        arrays = {}
        for name, (kind, shape, place) in content['arrays'].items():
            first = _HEAD.size + length + place
            size = int(np.prod(shape, dtype=np.int64)) * np.dtype(kind).itemsize
            arrays[name] = np.asarray(mapped[first : first + size]).view(kind).reshape(shape)
        return cls(arrays, content['about'])


FOLDER = 'workbench_cache'
"""Beside the index of recordings."""
_CODE = (
    *('power_recordings', 'power_estimator.effects', 'power_estimator.judge'),
    *('power_lab.compare', 'power_workbench.views.view', 'power_workbench.sessions.described'),
    'power_workbench.sessions.opened_cache',
)
_MOST = 4 << 30  # bytes of all files
_ROOM = 1 << 30  # bytes that stay free on the disk
_UNFINISHED = 3600.0  # s, after which a file that was never renamed is deleted
_ARRAYS = ('slots', 'time', 'recording', 'measured', 'noise')
_TEXTS = ('meters', 'drives', 'recordings', 'still')
_SETS = ('motor_torque', 'current_as_torque', 'computed_power')


@dataclass(frozen=True)
class KeptOpening:
    """Recordings as the page shows them without a model."""

    view: PowerView
    recordings: tuple[dict[str, Any], ...]
    sha256: tuple[str, ...]

    @property
    def result(self) -> dict[str, Any]:
        """Result of the worker's request `open`: view, recordings and sha256."""
        return dict(vars(self))


class OpenedCache:
    """Views and aligned signals of recordings, in files below a folder.

    What is kept counts for the stamps of the recordings and for the code that made it: of a
    recording that changed, nothing is known. A file that is torn counts for none. What cannot be
    written is not kept; the files that were used longest ago give way to new ones.
    """

    def __init__(self, folder: Path | None, most: int = _MOST, room: int = _ROOM) -> None:
        """folder: None keeps nothing; most: bytes of its files; room: left free on the disk."""
        self._folder, self._most, self._room = folder, most, room

    @classmethod
    def usual(cls) -> 'OpenedCache':
        """Return the cache beside the index of recordings; without an index it keeps nothing."""
        index = usual_path()
        return cls(None if index is None else index.parent / FOLDER)

    def key(self, source: Source) -> str:
        """Return the key of recordings as they are now on disk; '' where nothing can be kept."""
        if self._folder is None:
            return ''
        try:
            stamps = [Stamp.of(Path(path)) for path in source.recordings]
        except InputError:
            return ''
        how = (stamps, *vars(source.unchecked).values())
        return hashlib.sha256(f'{code_fingerprint(*_CODE)} {how}'.encode()).hexdigest()[:32]

    def opening(self, key: str) -> KeptOpening | None:
        """Return recordings without a model, None where they are not kept."""
        found = self._read(key, 'view')
        if found is None:
            return None
        arrays, about = found.arrays, found.about
        own: dict[str, Any] = {name: tuple(about[name]) for name in _TEXTS}
        own |= {name: arrays[name] for name in _ARRAYS}
        view = PowerView(
            **own,
            state=_named(arrays, 'state '),
            words={
                name: StateWords(tuple(texts), arrays[f'words {name}'])
                for name, texts in about['words'].items()
            },
            left_out=spans_of(about['left_out']),
        )
        return KeptOpening(view, tuple(about['described']), tuple(about['sha256']))

    def keep_opening(self, key: str, opening: KeptOpening) -> None:
        """Keep recordings without a model, unless the disk has no room."""
        view = opening.view
        arrays: dict[str, NDArray[Any]] = {name: getattr(view, name) for name in _ARRAYS}
        arrays |= {f'state {name}': values for name, values in view.state.items()}
        arrays |= {f'words {name}': words.places for name, words in view.words.items()}
        about = {
            **{name: getattr(view, name) for name in _TEXTS},
            'words': {name: words.texts for name, words in view.words.items()},
            'left_out': [str(span) for span in view.left_out],
            'described': opening.recordings,
            'sha256': opening.sha256,
        }
        self._write(key, 'view', ArrayFile(arrays, about))

    def loaded(self, key: str) -> Loaded | None:
        """Return aligned signals, mapped from a file, None where they are not kept."""
        found = self._read(key, 'signals')
        if found is None:
            return None
        about = found.about
        own: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in about['data'].items()
        }
        own |= {name: frozenset(own[name]) for name in _SETS}
        own |= {name: v for name, v in found.arrays.items() if not name.startswith('extra ')}
        return Loaded(
            AlignedDataset(**own, extras=_named(found.arrays, 'extra ')),
            ReadAgain([Path(path) for path in about['paths']]),
            tuple(about['identities']),
            tuple(about['controllers']),
            about['window'],
        )

    def keep_loaded(self, key: str, loaded: Loaded, paths: Sequence[Path]) -> None:
        """Keep aligned signals of recordings at paths, unless the disk has no room."""
        own = {one.name: getattr(loaded.data, one.name) for one in fields(loaded.data)}
        extras = own.pop('extras')
        arrays = {name: value for name, value in own.items() if isinstance(value, np.ndarray)}
        rest = {name: value for name, value in own.items() if name not in arrays}
        about = {
            'data': rest | {name: sorted(own[name]) for name in _SETS},
            'paths': [str(path) for path in paths],
            'identities': [dict(one) for one in loaded.identities],
            'controllers': loaded.controllers,
            'window': loaded.window,
        }
        arrays |= {f'extra {name}': values for name, values in extras.items()}
        self._write(key, 'signals', ArrayFile(arrays, about))

    def _path(self, key: str, kind: str) -> Path | None:
        return None if self._folder is None or not key else self._folder / f'{key}.{kind}'

    def _read(self, key: str, kind: str) -> ArrayFile | None:
        path = self._path(key, kind)
        if path is None:
            return None
        try:
            found = ArrayFile.read(path)
            with suppress(OSError):
                os.utime(path)  # used last
        except OSError:
            return None
        except ValueError:
            with suppress(OSError):
                path.unlink(missing_ok=True)
            return None
        return found

    def _write(self, key: str, kind: str, content: ArrayFile) -> None:
        path = self._path(key, kind)
        size = sum(values.nbytes for values in content.arrays.values())
        if path is None or size > self._most:
            return
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._make_room(path.parent, size)
            if shutil.disk_usage(path.parent).free - size >= self._room:
                content.write(path)
        except OSError:
            return  # a full disk costs the time to read again

    def _make_room(self, folder: Path, size: int) -> None:
        """Delete the files that were used longest ago, until one of size bytes may come."""
        own = []
        for path in folder.iterdir():
            if '.view' in path.name or '.signals' in path.name:
                with suppress(FileNotFoundError):
                    status = path.stat()
                    own.append((status.st_mtime, path, status.st_size))
        total, now = sum(bytes_ for *_, bytes_ in own), time.time()
        for used, path, bytes_ in sorted(own):
            lost = path.name.startswith('.') and now - used > _UNFINISHED
            if total + size > self._most or lost:
                path.unlink(missing_ok=True)
                total -= bytes_


class ReadAgain(Sequence[Recording]):
    """Recordings at paths, each of which is read anew whenever it is indexed."""

    def __init__(self, paths: Sequence[Path]) -> None:
        self._paths = tuple(paths)

    def __len__(self) -> int:
        return len(self._paths)

    def __getitem__(self, index: Any) -> Any:
        return Recording.open(self._paths[index])


def _named(arrays: Mapping[str, NDArray[Any]], start: str) -> dict[str, NDArray[Any]]:
    return {
        name.removeprefix(start): values
        for name, values in arrays.items()
        if name.startswith(start)
    }
