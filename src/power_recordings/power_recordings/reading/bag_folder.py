"""The files of a recording and their messages, for each kind of storage."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from wattwalk_core.errors import InputError
from wattwalk_core.files import reason
from wattwalk_core.quoting import printable
from wattwalk_core.yaml_file import read_yaml

from power_recordings.messages.batch import Batch, Topic
from power_recordings.reading.mcap_file import McapFile
from power_recordings.reading.sqlite_file import SqliteFile


@dataclass(frozen=True)
class Bag:
    """A bag folder or a single file of one."""

    path: Path
    folder: Path
    files: tuple[Path, ...]
    promised: int | None  # number of messages in metadata.yaml
    problems: tuple[str, ...]

    @property
    def is_sqlite(self) -> bool:
        """True if the messages are in rosbag2's sqlite3 storage."""
        return self.files[0].suffix == '.db3'

    def batches(
        self,
        problems: list[str],
        topics: dict[str, Topic],
        skip: Callable[[Mapping[str, int]], bool] | None = None,
        every: int = 1,
    ) -> Iterator[Batch]:
        """
        Yield all messages; add to `problems` and to the declared `topics`.

        skip: told the numbers of messages by topic of a chunk of which they are known, says
        whether to leave the chunk out. every: of the chunks of an MCAP file only every n-th.
        """
        for path in self.files:
            if self.is_sqlite:
                database = SqliteFile(path)
                yield from database.batches()
                file: McapFile | SqliteFile = database
            else:
                file = mcap = McapFile(path)
                yield from mcap.batches(None if skip is None else _by_name(mcap, skip), every)
            problems += file.problems
            topics.update({topic.name: topic for topic in file.topics.values()})


def _by_name(
    file: McapFile, skip: Callable[[Mapping[str, int]], bool]
) -> Callable[[Mapping[int, int]], bool]:
    def skip_chunk(counts: Mapping[int, int]) -> bool:
        known = counts.keys() <= file.topics.keys()
        return known and skip({file.topics[c].name: n for c, n in counts.items()})

    return skip_chunk


def check_recordings(paths: Iterable[Path]) -> None:
    """Raise InputError for the first of the paths at which there is no recording."""
    for path in paths:
        find(path)


def find(path: Path) -> Bag:
    """
    Return the bag at path, which is its folder or its .mcap or .db3 file.

    Raises InputError if there is none, or if it is compressed as a whole.
    """
    try:
        path.stat()
    except (OSError, ValueError) as error:
        raise InputError(f'there is no recording {path}: {reason(error)}') from None
    if not path.is_dir():
        if path.suffix not in ('.mcap', '.db3'):
            raise InputError(f'{path} is not a recording: expected a bag folder or an .mcap file')
        return Bag(path, path.parent, (path,), None, ())
    if (path / 'metadata.yaml').exists():
        return _described(path)
    files = sorted(path.glob('*.mcap'), key=_number)
    if files:
        note = 'no metadata.yaml: the recorder was killed'
        return Bag(path, path, tuple(files), None, (note,))
    if any(path.glob('*.db3')):
        raise InputError(
            f'{path} has no metadata.yaml: run `ros2 bag reindex {path} sqlite3` first'
        )
    raise InputError(f'{path} is not a recording: it holds neither metadata.yaml nor *.mcap')


def _described(path: Path) -> Bag:
    file = path / 'metadata.yaml'
    try:
        content: Any = read_yaml(file, 'metadata')
        information = content['rosbag2_bagfile_information']
        names = [str(name) for name in information['relative_file_paths']]
        promised = int(information['message_count'])
        compressed = str(information.get('compression_mode') or '').lower()
    except (InputError, KeyError, TypeError, ValueError, AttributeError):
        files = sorted(path.glob('*.mcap'), key=_number)
        if not files:
            raise InputError(f'{file} is damaged and there is no .mcap file beside it') from None
        return Bag(path, path, tuple(files), None, ('metadata.yaml is damaged: not used',))
    if compressed in ('file', 'message'):
        raise InputError(
            f'{path} is compressed by {compressed}: run `ros2 bag convert` without '
            'compression_mode (compression inside MCAP is fine)'
        )
    listed = [path / Path(name).name for name in names]
    there = tuple(file for file in listed if file.exists())
    if not there:
        raise InputError(
            f'{path} lacks its data: metadata.yaml lists {printable(", ".join(names), 120)}'
        )
    missing = [file.name for file in listed if not file.exists()]
    more = f' and {len(missing) - 3} more' if len(missing) > 3 else ''
    problems = (f'{", ".join(missing[:3])}{more} is missing',) if missing else ()
    return Bag(path, path, there, promised, problems)


def _number(path: Path) -> tuple[int, str]:
    digits = path.stem.rsplit('_', 1)[-1]
    return (int(digits) if digits.isdigit() else 0, path.name)
