"""Folders that were named: the only places that the page may read from."""

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from power_recordings.card import FILE, Card
from power_recordings.index.store import (
    IndexAnswer,
    RecordingFacts,
    RecordingIndex,
    Stamp,
    usual_path,
)
from power_recordings.reading.bag_folder import find
from wattwalk_core.errors import InputError
from wattwalk_core.files import code_fingerprint
from wattwalk_core.yaml_file import read_yaml

from power_workbench.files.logs import ENDINGS

_DEPTH = 3
_MOST = 500  # recordings that are listed
_KIND = 'listed_with_length'  # answers of the index


@dataclass(frozen=True)
class Folders:
    """Roots below which recordings, models and logs are found; all others are refused."""

    roots: tuple[Path, ...]

    @classmethod
    def of(cls, named: Sequence[Path]) -> 'Folders':
        """Return roots of the paths that were named, links resolved; absent ones are left out."""
        return cls(tuple(dict.fromkeys(path.resolve() for path in named if path.exists())))

    def within(self, given: str) -> Path:
        """Return a path below a root, without links; InputError for any other, absent or not."""
        refused = InputError(
            f'{given!r} is not in a folder that was named when the workbench was opened'
        )
        if '\0' in given or not given:
            raise refused
        try:
            path = Path(given).resolve()
        except (OSError, RuntimeError):
            raise refused from None
        if not any(path == root or root in path.parents for root in self.roots):
            raise refused
        if not path.exists():
            raise InputError(f'{given!r} does not exist')
        return path

    def check_model(self, spec: str) -> None:
        """Raise InputError for a model whose file is not below a root; a proxy has none."""
        if spec.endswith(('.yaml', '.yml')) or spec.startswith('ppn:'):
            self.within(spec.removeprefix('ppn:'))

    def recordings(self) -> list[dict[str, Any]]:
        """Return path, name, card and faults of recordings below the roots, without samples."""
        found: dict[Path, dict[str, Any]] = {}
        with _index() as index:
            for root in self.roots:
                is_bag = root.is_file() and root.suffix in ('.mcap', '.db3')
                for path in [root] if is_bag else _below(root, _DEPTH, _is_bag_folder):
                    if len(found) < _MOST and path not in found:
                        found[path] = {'path': str(path), 'name': path.name, **_said(path, index)}
        return sorted(found.values(), key=lambda one: str(one['path']))

    def models(self) -> list[str]:
        """Return YAML files below the roots, which may be models, and networks as `ppn:RUN`."""
        networks = [Path(path) for path in self.files(('.safetensors',))]
        runs = [f'ppn:{path.parent}' for path in networks if path.name == 'model.safetensors']
        return [*runs, *self.files(('.yaml', '.yml'))]

    def logs(self) -> list[str]:
        """Return files below the roots that may be logs of others, not of a recording or a run."""
        own = {Path(one['path']) for one in self.recordings() if 'problem' not in one}
        own |= {Path(run.removeprefix('ppn:')) for run in self.models() if run.startswith('ppn:')}
        files = [Path(path) for path in self.files(ENDINGS)]
        return [str(path) for path in files if not {path, *path.parents} & own]

    def files(self, suffixes: Sequence[str]) -> list[str]:
        """Return the files below the roots with one of the suffixes, sorted; 500 at most."""
        found = {
            str(path)
            for root in self.roots
            for path in _below(root, _DEPTH, Path.is_file)
            if path.suffix.lower() in suffixes
        }
        return sorted(found)[:_MOST]


def _below(path: Path, depth: int, is_wanted: Callable[[Path], bool]) -> Iterator[Path]:
    """Paths that are wanted, in folders `depth` deep, but none below another.

    A link is not followed, so that nothing outside a root is listed.
    """
    if is_wanted(path):
        yield path
    elif depth and path.is_dir():
        with suppress(OSError):
            for inner in sorted(path.iterdir()):
                if not inner.is_symlink() and not inner.name.startswith('.'):
                    yield from _below(inner, depth - 1, is_wanted)


def _is_bag_folder(path: Path) -> bool:
    try:
        return path.is_dir() and ((path / 'metadata.yaml').exists() or any(path.glob('*.mcap')))
    except OSError:
        return False


def _index() -> RecordingIndex:
    """The index of recordings; none in place of a file that is no index."""
    try:
        return RecordingIndex(usual_path())
    except InputError:
        return RecordingIndex(None)


def _extent(folder: Path) -> dict[str, Any]:
    """Seconds and date of a bag by its metadata, which a recording that was cut off lacks."""
    try:
        about = read_yaml(folder / 'metadata.yaml', 'metadata')['rosbag2_bagfile_information']
        start = about['starting_time']['nanoseconds_since_epoch'] / 1e9
        seconds = about['duration']['nanoseconds'] / 1e9
        date = datetime.fromtimestamp(start, UTC).date().isoformat()
    except (InputError, KeyError, TypeError, ValueError, OverflowError):
        return {}
    return {'seconds': seconds, 'date': date}


def _said(path: Path, index: RecordingIndex) -> dict[str, Any]:
    """The card's words and what is wrong with a recording, from the index where it has them."""
    try:
        stamp = Stamp.of(path)
    except InputError as error:
        return {'problem': str(error)}
    key = code_fingerprint('power_recordings')
    kept = index.answer(stamp, _KIND, key)
    if kept is not None:
        known: dict[str, Any] = json.loads(kept)
        return known
    try:
        folder = find(path).folder
        card = Card.load(folder) if (folder / FILE).exists() else Card()
    except InputError as error:
        return {'problem': str(error)}
    said = {'robot': card.robot, 'controller': card.controller, 'drives': len(card.drives)}
    said |= _extent(folder)
    index.keep(stamp, RecordingFacts(card), IndexAnswer(_KIND, key, json.dumps(said).encode()))
    return said
