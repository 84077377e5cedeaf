"""The files of a recording and their messages, for each kind of storage."""

import re
import sqlite3
from collections.abc import Iterable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from wattwalk_core.errors import InputError, printable
from wattwalk_core.files import reason
from wattwalk_core.yaml_file import read_yaml

from power_recordings.messages.batch import Batch, MessageFile, Skip, Topic, joined
from power_recordings.reading.mcap_file import McapFile
from power_recordings.reading.ros1_file import Ros1File

_BLOCK: Final = 4096  # messages
_LARGEST: Final = 256 << 20  # bytes of a message
_COMPUTED = re.compile(r'\b(virtual|generated|as)\b', re.IGNORECASE)


class SqliteFile(MessageFile):
    """A .db3 file, opened read-only; views, triggers and generated columns are not evaluated.

    Raises InputError for other files.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        try:
            with closing(self._connect()) as database:
                self._declare(database)
        except (sqlite3.Error, ValueError, TypeError) as error:
            raise InputError(f'{path}: not a readable bag: {printable(str(error))}') from None

    def batches(self) -> Iterator[Batch]:
        """Yield the messages in the order of their times, up to the first damage."""
        waiting: dict[int, list[tuple[int, bytes]]] = {}
        seen = rows = 0
        try:
            with closing(self._connect()) as database:
                for number, time, raw in database.execute(
                    'SELECT topic_id, timestamp, data FROM messages ORDER BY timestamp, id'
                ):
                    seen, rows = seen + len(raw), rows + 1
                    if seen > self._size or rows > self._size:
                        raise ValueError('more messages than the file can hold')
                    if number not in self.topics or not 0 <= time < 2**63:
                        raise ValueError(f'a message of topic {number} at {time}')
                    messages = waiting.setdefault(number, [])
                    messages.append((time, bytes(raw)))
                    if len(messages) == _BLOCK:
                        yield joined(self.topics[number], waiting.pop(number))
        except (sqlite3.Error, ValueError, TypeError) as error:
            self.problems.append(f'{self.path.name} is damaged: {printable(str(error))}')
        for number, messages in waiting.items():
            yield joined(self.topics[number], messages)

    def _connect(self) -> sqlite3.Connection:
        where = quote(str(self.path.absolute()))
        database = sqlite3.connect(f'file:{where}?immutable=1&mode=ro', uri=True)
        database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, _LARGEST)
        database.execute('PRAGMA trusted_schema = OFF')
        return database

    def _declare(self, database: sqlite3.Connection) -> None:
        made: dict[str, str] = dict(
            database.execute("SELECT name, sql FROM sqlite_master WHERE type = 'table'").fetchall()
        )
        if not {'topics', 'messages'} <= made.keys():
            raise ValueError('no tables of topics and messages')
        if any(_COMPUTED.search(made[name]) for name in ('topics', 'messages')):
            raise ValueError('its tables are computed')
        texts: dict[str, str] = {}
        if not _COMPUTED.search(made.get('message_definitions', 'as')):
            columns = 'topic_type, encoded_message_definition'
            texts = dict(
                database.execute(
                    f'SELECT {columns} FROM message_definitions LIMIT 65536'
                ).fetchall()
            )
        for number, name, kind, encoding in database.execute(
            'SELECT id, name, type, serialization_format FROM topics LIMIT 65536'
        ):
            text = texts.get(str(kind), '')
            self.topics[int(number)] = Topic(str(name), str(kind), str(encoding), str(text))


@dataclass(frozen=True)
class Bag:
    """A recording on disk: the files of a bag folder, or a single file."""

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
        self, problems: list[str], topics: dict[str, Topic], skip: Skip = None, every: int = 1
    ) -> Iterator[Batch]:
        """Yield all messages; add to `problems` and to the declared `topics`.

        skip: returns whether to omit a chunk, given its numbers of messages by topic where known.
        every: read only every n-th chunk of an MCAP file.
        """
        for path in self.files:
            file: McapFile | SqliteFile | Ros1File
            if self.is_sqlite or path.suffix.lower() == '.bag':
                file = SqliteFile(path) if self.is_sqlite else Ros1File(path)
                yield from file.batches()
            else:
                file = McapFile(path)
                yield from file.batches(skip, every)
            problems += file.problems
            topics.update({topic.name: topic for topic in file.topics.values()})


def check_recordings(paths: Iterable[Path]) -> None:
    """Raise InputError for the first of the paths at which there is no recording."""
    for path in paths:
        find(path)


def find(path: Path) -> Bag:
    """Return the bag at path, which is its folder or its .mcap or .db3 file.

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
    files = tuple(sorted(path.glob('*.mcap'), key=_number))
    if (path / 'metadata.yaml').exists():
        return _described(path, files)
    if files:
        return Bag(path, path, files, None, ('no metadata.yaml: the recorder was killed',))
    if any(path.glob('*.db3')):
        raise InputError(
            f'{path} has no metadata.yaml: run `ros2 bag reindex {path} sqlite3` first'
        )
    raise InputError(f'{path} is not a recording: it holds neither metadata.yaml nor *.mcap')


def _described(path: Path, files: tuple[Path, ...]) -> Bag:
    file = path / 'metadata.yaml'
    try:
        content: Any = read_yaml(file, 'metadata')
        information = content['rosbag2_bagfile_information']
        names = [str(name) for name in information['relative_file_paths']]
        promised = int(information['message_count'])
        compressed = str(information.get('compression_mode') or '').lower()
    except (InputError, KeyError, TypeError, ValueError, AttributeError):
        if not files:
            raise InputError(f'{file} is damaged and there is no .mcap file beside it') from None
        return Bag(path, path, files, None, ('metadata.yaml is damaged: not used',))
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
    return (int(digits) if digits.isdecimal() else 0, path.name)
