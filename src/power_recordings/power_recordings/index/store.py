"""SQLite store of cards, quality and fits by recording; a cache that may be deleted."""

import fcntl
import json
import os
import sqlite3
import zlib
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import IO, Any, Self, TypeVar

from wattwalk_core.errors import InputError
from wattwalk_core.files import advice, reason

from power_recordings.card import FILE, Card

_WHOLE = (1 << 63) - 1  # that SQLite's numbers go to


@dataclass(frozen=True)
class Stamp:
    """Path, bytes and dates of a recording's files and its card.

    size [bytes] and changed [dates in ns, modulo 2⁶³] are sums over the files, so that a change of
    any of them shows.
    """

    path: str
    size: int
    changed: int

    @classmethod
    def of(cls, path: Path) -> Self:
        """Stamp a bag folder or file, before it is read; InputError where there is none."""
        try:
            # Path.resolve raises RuntimeError for links in a circle; this raises OSError.
            own = Path(os.path.realpath(path, strict=True))
            if own.is_dir():
                with os.scandir(own) as entries:
                    found = [entry.stat() for entry in entries if entry.is_file()]
            else:
                beside = (own, own.parent / FILE)
                found = [file.stat() for file in beside if file.exists()]
        except (OSError, ValueError) as error:
            raise InputError(f'there is no recording {path}: {reason(error)}') from None
        size = sum(status.st_size for status in found)
        changed = sum(status.st_mtime_ns for status in found) & _WHOLE
        return cls(str(own), size, changed)


T = TypeVar('T')

ENVIRONMENT = 'WATTWALK_INDEX'  # variable that names the file of the index; empty for none
VERSION = 1
_APPLICATION = 0x77617474  # 'watt', in the header of the file
_MAGIC = b'SQLite format 3\0'
_PLACE = 68  # of the application's number in the header
_PAGE = 32768  # bytes; a fit of twelve drives takes two
_PATIENCE = 5.0  # s that another process may hold the file
_TABLES = """
CREATE TABLE recordings (
    id INTEGER PRIMARY KEY, path TEXT UNIQUE NOT NULL, size INTEGER, changed INTEGER,
    name TEXT, robot TEXT, unit TEXT, controller TEXT, terrain TEXT, created TEXT,
    start REAL, seconds REAL, card TEXT);
CREATE INDEX by_robot ON recordings (robot, unit, start);
CREATE TABLE answers (
    recording INTEGER NOT NULL REFERENCES recordings ON DELETE CASCADE,
    kind TEXT NOT NULL, key TEXT NOT NULL, checksum INTEGER NOT NULL, content BLOB NOT NULL,
    UNIQUE (recording, kind, key));
CREATE TABLE figures (
    recording INTEGER NOT NULL REFERENCES recordings ON DELETE CASCADE,
    kind TEXT NOT NULL, key TEXT NOT NULL, model TEXT, drive TEXT, name TEXT, term INTEGER,
    unit TEXT, value REAL, error REAL);
CREATE INDEX by_recording ON figures (recording, kind, key);
"""


@dataclass(frozen=True)
class RecordingFacts:
    """Card of a recording, and its start [s since 1970] and length [s] where they are known."""

    card: Card
    start: float | None = None
    seconds: float | None = None


@dataclass(frozen=True)
class DriveFigure:
    """A number of one drive in an answer, for exported tables: value ± standard error.

    term: index of the coefficient within the effect `name`; model: that of the fit.
    """

    drive: str
    name: str
    value: float
    unit: str = ''
    term: int = 0
    error: float | None = None
    model: str = ''


@dataclass(frozen=True)
class IndexAnswer:
    """Cached result for a recording: its kind, a key (hash of code or model) and its bytes."""

    kind: str
    key: str
    content: bytes
    figures: Sequence[DriveFigure] = ()


def usual_path() -> Path | None:
    """Return the index's path: WATTWALK_INDEX (None if empty), else in the user's cache."""
    named = os.environ.get(ENVIRONMENT)
    if named is not None:
        return Path(named) if named else None
    cache = os.environ.get('XDG_CACHE_HOME') or Path.home() / '.cache'
    return Path(cache) / 'wattwalk' / 'recordings.sqlite3'


class RecordingIndex:
    """Answers by recording, in a file that several processes may use at once.

    An answer counts for the stamp that it was kept with: a recording that changed has none. Each
    is on disk when `keep` returns. A file that is torn, or of another version, is begun anew; one
    that cannot be used at all leaves the index empty, and `off` says why.
    """

    def __init__(self, path: Path | None) -> None:
        """Open or create the index (None: use none); InputError for another program's file."""
        self.path = path
        self.off = '' if path is not None else 'no index is wanted'
        self._database: sqlite3.Connection | None = None
        self._lock: IO[str] | None = None
        if path is None:
            return
        try:
            _refuse_foreign(path)
            path.parent.mkdir(parents=True, exist_ok=True)
            self._lock = path.with_name(path.name + '.lock').open('a')
            fcntl.flock(self._lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
            self._database = _connected(path)
        except (OSError, sqlite3.OperationalError) as error:
            told = advice(error) if isinstance(error, OSError) else error
            self._end(f'the index {path} cannot be used: {told}')
            return
        self._asked(_prepare, None)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._end(self.off)

    def answer(self, stamp: Stamp, kind: str, key: str) -> bytes | None:
        """Return the content kept for the recording in its present state, None if absent."""
        found = self.rows(
            'SELECT checksum, content FROM answers JOIN recordings ON recording = id '
            'WHERE path = ? AND size = ? AND changed = ? AND kind = ? AND key = ?',
            (stamp.path, stamp.size, stamp.changed, kind, key),
        )
        return next(
            (content for checksum, content in found if zlib.crc32(content) == checksum), None
        )

    def knows(self, stamp: Stamp) -> bool:
        """Return whether the index has the card of the recording in its present state."""
        query = 'SELECT 1 FROM recordings WHERE path = ? AND size = ? AND changed = ?'
        return bool(self.rows(query, (stamp.path, stamp.size, stamp.changed)))

    def keep(self, stamp: Stamp, about: RecordingFacts, answer: IndexAnswer | None = None) -> None:
        """Store a card and, if given, an answer, which replaces one of its kind and key."""
        self._asked(lambda database: _keep(database, stamp, about, answer), None)

    def rows(self, query: str, values: Sequence[Any] = ()) -> list[tuple[Any, ...]]:
        """Return rows of an SQL query on `recordings`, `answers`, `figures`; none if `off`."""
        return self._asked(lambda database: database.execute(query, values).fetchall(), [])

    def forget_lost(self) -> int:
        """Forget recordings whose files are gone; return their number."""
        lost = [
            (number,)
            for number, path in self.rows('SELECT id, path FROM recordings')
            if not Path(path).exists()
        ]

        def forget(database: sqlite3.Connection) -> None:
            with database:
                database.executemany('DELETE FROM recordings WHERE id = ?', lost)

        self._asked(forget, None)
        return len(lost)

    def _asked(self, ask: Callable[[sqlite3.Connection], T], nothing: T) -> T:
        """Ask the file; begin a torn one anew, and go on without one that cannot be used."""
        try:
            return nothing if self._database is None else ask(self._database)
        except sqlite3.OperationalError as error:
            self._end(f'the index {self.path} cannot be used: {error}')
        except sqlite3.DatabaseError as error:
            self._renew(str(error))
        return nothing

    def _renew(self, why: str) -> None:
        """Delete a torn file and begin anew, unless another process has it open."""
        assert self.path is not None
        assert self._lock is not None
        self._close()
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            for end in ('', '-journal', '-wal', '-shm'):
                self.path.with_name(self.path.name + end).unlink(missing_ok=True)
            self._database = _connected(self.path)
            _prepare(self._database)
            fcntl.flock(self._lock, fcntl.LOCK_SH)
        except (OSError, sqlite3.Error) as error:
            self._end(f'the index {self.path} is torn ({why}) and cannot be renewed: {error}')

    def _close(self) -> None:
        if self._database is not None:
            with suppress(sqlite3.Error):
                self._database.close()
            self._database = None

    def _end(self, why: str) -> None:
        self.off = why
        self._close()
        if self._lock is not None:
            self._lock.close()
            self._lock = None


def _connected(path: Path) -> sqlite3.Connection:
    return sqlite3.connect(path, timeout=_PATIENCE, isolation_level='IMMEDIATE')


def _version(database: sqlite3.Connection) -> int:
    return int(database.execute('PRAGMA user_version').fetchone()[0])


def _prepare(database: sqlite3.Connection) -> None:
    """Set up a connection, and make the tables in a new file or in place of another version's."""
    # A power cut may tear the file, which is seen and costs no more than to begin anew.
    database.execute('PRAGMA synchronous = OFF')
    database.execute(f'PRAGMA page_size = {_PAGE}')  # of a file that is made now
    database.execute('PRAGMA foreign_keys = ON')
    if _version(database) == VERSION:
        return
    with database:
        database.execute('BEGIN EXCLUSIVE')
        if _version(database) == VERSION:
            return  # another process was first
        tables = "SELECT name FROM sqlite_master WHERE type = 'table' ORDER BY name"
        for (name,) in database.execute(tables).fetchall():
            database.execute(f'DROP TABLE IF EXISTS "{name}"')
        for statement in filter(str.strip, _TABLES.split(';')):
            database.execute(statement)
        database.execute(f'PRAGMA application_id = {_APPLICATION}')
        database.execute(f'PRAGMA user_version = {VERSION}')


def card_content(card: Card) -> dict[str, Any]:
    """Return the non-empty entries of a card, as `Card.of` takes them."""
    content = asdict(card)
    content |= content.pop('other')
    return {key: value for key, value in content.items() if value not in ('', None, (), {})}


def _refuse_foreign(path: Path) -> None:
    """InputError for a file that is no index, so that none of another program is overwritten."""
    if not path.exists():
        return
    if not path.is_file():
        raise InputError(f'the index {path} is no file: name another by {ENVIRONMENT}')
    with path.open('rb') as file:
        head = file.read(_PLACE + 4)
    number = int.from_bytes(head[_PLACE:], 'big')
    lost = not head.strip(b'\0')  # what a power cut may leave
    if not lost and not (head.startswith(_MAGIC) and number == _APPLICATION):
        raise InputError(
            f'{path} is no index of recordings: delete it or name another by {ENVIRONMENT}'
        )


def _keep(
    database: sqlite3.Connection, stamp: Stamp, about: RecordingFacts, answer: IndexAnswer | None
) -> None:
    with database:
        card = about.card
        state = (stamp.path, stamp.size, stamp.changed)
        entries = (card.robot, card.unit, card.controller, card.terrain, card.created)
        content = json.dumps(card_content(card), default=str)
        # This begins the transaction, so that no other process adds the recording meanwhile.
        database.execute(
            'DELETE FROM recordings WHERE path = ? AND (size <> ? OR changed <> ?)', state
        )
        database.execute(
            'INSERT OR IGNORE INTO recordings (path, size, changed, name, robot, unit, '
            'controller, terrain, created, card) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)',
            (*state, Path(stamp.path).name, *entries, content),
        )
        query = 'SELECT id FROM recordings WHERE path = ?'
        (number,) = database.execute(query, (stamp.path,)).fetchone()
        if about.start is not None:
            database.execute(
                'UPDATE recordings SET start = ?, seconds = ? WHERE id = ?',
                (about.start, about.seconds, number),
            )
        if answer is None:
            return
        place = (number, answer.kind, answer.key)
        database.execute(
            'INSERT OR REPLACE INTO answers VALUES (?, ?, ?, ?, ?)',
            (*place, zlib.crc32(answer.content), answer.content),
        )
        database.execute('DELETE FROM figures WHERE recording = ? AND kind = ? AND key = ?', place)
        database.executemany(
            'INSERT INTO figures VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)',
            (
                (*place, f.model, f.drive, f.name, f.term, f.unit, f.value, f.error)
                for f in answer.figures
            ),
        )
