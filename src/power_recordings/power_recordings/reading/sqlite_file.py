"""The messages of rosbag2's SQLite storage in batches."""

import re
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from wattwalk_core.errors import InputError
from wattwalk_core.files import regular_size
from wattwalk_core.quoting import printable

from power_recordings.messages.batch import Batch, Topic, joined

_BLOCK: Final = 4096  # messages
_LARGEST: Final = 256 << 20  # bytes of a message
_COMPUTED = re.compile(r'\b(virtual|generated|as)\b', re.IGNORECASE)


class SqliteFile:
    """
    A .db3 file, read only and without running what is stored in it: plain tables alone are read.

    `problems` is complete once `batches` is exhausted. Raises InputError for anything else.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.problems: list[str] = []
        self.topics: dict[int, Topic] = {}
        self._size = regular_size(path, 'recording')
        try:
            with closing(self._connect()) as database:
                self._declare(database)
        except (sqlite3.Error, ValueError, TypeError) as error:
            raise self._damaged(error) from None

    def batches(self) -> Iterator[Batch]:
        """Yield the messages in the order of their times; what is damaged ends them."""
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
            texts = dict(
                self._rows(
                    database, 'topic_type, encoded_message_definition FROM message_definitions'
                )
            )
        for number, name, kind, encoding in self._rows(
            database, 'id, name, type, serialization_format FROM topics'
        ):
            text = texts.get(str(kind), '')
            self.topics[int(number)] = Topic(str(name), str(kind), str(encoding), str(text))

    def _rows(self, database: sqlite3.Connection, what: str) -> list[tuple[Any, ...]]:
        return database.execute(f'SELECT {what} LIMIT 65536').fetchall()

    def _damaged(self, error: Exception) -> InputError:
        return InputError(f'{self.path}: not a readable bag: {printable(str(error))}')
