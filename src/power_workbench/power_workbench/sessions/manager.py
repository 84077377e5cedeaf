"""Sessions of all tabs, the folders that they may use, and their beginning and end."""

import datetime
import re
import secrets
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from wattwalk_core.errors import InputError
from wattwalk_core.files import check_room

from power_workbench.files.folders import Folders
from power_workbench.sessions.opened_cache import OpenedCache
from power_workbench.sessions.session import WorkbenchSession
from power_workbench.sessions.steps import FILE, SessionRecord, SessionStep

_NAME = re.compile(r'[\w-]{1,64}')
_MOST_AT_WORK = 4
"""Sessions that have a worker; the one that was used longest ago loses its own."""


@dataclass
class SessionManager:
    """Sessions, folders and cache of one server; `changed` and `streamed` wake those who wait."""

    folder: Path  # of the sessions
    folders: Folders
    start: tuple[SessionStep, ...] = ()  # of a new session
    approved: tuple[str, ...] = ()  # files of effects named with the command
    changed: Callable[[], None] = lambda: None
    streamed: Callable[[], None] = lambda: None
    ending: bool = False
    cache: OpenedCache = field(default_factory=OpenedCache.usual)
    at_work: dict[str, WorkbenchSession] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def new(self) -> str:
        """Begin a session in a new folder and return its name; InputError if it cannot be made."""
        with self._lock:
            now = datetime.datetime.now().strftime('%Y%m%d-%H%M%S')
            name = f'{now}-{secrets.token_hex(2)}'
            folder = self.folder / name
            try:
                folder.mkdir(parents=True)
            except OSError as error:
                raise InputError(f'cannot make {folder}: {error.strerror}') from error
            check_room(folder / FILE)
            session = self._begin(name, SessionRecord())
            session.record.save(folder)
        if self.start:
            session.take(*self.start)
        else:
            session.runner.warm()
        return name

    def session(self, name: str) -> WorkbenchSession:
        """Return a session by name, taken up from its folder if need be; InputError for none."""
        with self._lock:
            if name in self.at_work:
                self.at_work[name] = self.at_work.pop(name)  # used last
                return self.at_work[name]
            folder = self.folder / name
            if not _NAME.fullmatch(name) or not (folder / FILE).is_file():
                raise InputError(f'there is no session {name!r}')
            session = self._begin(name, SessionRecord.read(folder))
        session.resume()
        return session

    def sessions(self) -> list[dict[str, Any]]:
        """Return name, steps, recordings and effects of the last 50 sessions, the latest first."""
        found = []
        for file in sorted(self.folder.glob(f'*/{FILE}'), reverse=True)[:50]:
            try:
                record = SessionRecord.read(file)
            except InputError:
                continue
            if record.steps:
                paths = record.opened.recordings if record.opened else ()
                added = [name for s in record.done if s.kind == 'add' for name in s.effects]
                found.append(
                    {
                        'name': file.parent.name,
                        'steps': len(record.steps),
                        'recordings': [Path(path).name for path in paths],
                        'effects': [*dict.fromkeys(added)],
                    }
                )
        return found

    def readable(self, session: WorkbenchSession) -> Folders:
        """Return the folders that were named, and that of the session."""
        return Folders.of([*self.folders.roots, session.folder])

    def end(self) -> None:
        """Wake all who wait for news, as the server ends."""
        self.ending = True
        self.changed()
        self.streamed()

    def close(self) -> None:
        """End all workers."""
        for session in self.at_work.values():
            session.close()

    def _begin(self, name: str, record: SessionRecord) -> WorkbenchSession:
        while len(self.at_work) >= _MOST_AT_WORK:
            idle: Sequence[str] = [n for n, d in self.at_work.items() if not d.runner.busy]
            if not idle:
                raise InputError(f'{len(self.at_work)} sessions are at work; wait for one of them')
            self.at_work.pop(idle[0]).close()
        folder = self.folder / name
        session = WorkbenchSession(
            folder, record, lambda: self.changed(), lambda: self.streamed(), self.cache
        )
        session.approved.update(self.approved)
        self.at_work[name] = session
        return session
