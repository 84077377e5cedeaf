"""The workbench: sessions of all tabs, the folders that they may use, how they are begun."""

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

from power_lab.workbench.desk import Desk
from power_lab.workbench.folders import Folders
from power_lab.workbench.opened_cache import OpenedCache
from power_lab.workbench.session import FILE, LabSession, SessionStep

_NAME = re.compile(r'[\w-]{1,64}')
_MOST_DESKS = 4
"""Sessions that have a worker; the one that was used longest ago loses its own."""


@dataclass
class Bench:
    """Everything that one server serves."""

    folder: Path  # of the sessions
    folders: Folders
    start: tuple[SessionStep, ...] = ()  # of a new session
    approved: tuple[str, ...] = ()  # files of effects named with the command
    changed: Callable[[], None] = lambda: None
    streamed: Callable[[], None] = lambda: None
    ending: bool = False
    cache: OpenedCache = field(default_factory=OpenedCache.usual)
    desks: dict[str, Desk] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def new(self) -> str:
        """Begin a session, with the recordings and the model that the command named."""
        with self._lock:
            now = datetime.datetime.now().strftime('%Y%m%d-%H%M%S')
            name = f'{now}-{secrets.token_hex(2)}'
            folder = self.folder / name
            try:
                folder.mkdir(parents=True)
            except OSError as error:
                raise InputError(f'cannot make {folder}: {error.strerror}') from error
            check_room(folder / FILE)
            desk = self._seat(name, LabSession())
            desk.session.save(folder)
        if self.start:
            desk.take(*self.start)
        else:
            desk.runner.warm()
        return name

    def desk(self, name: str) -> Desk:
        """A session at work, or one of an earlier run taken up again; InputError for none."""
        with self._lock:
            if name in self.desks:
                desk = self.desks.pop(name)
                self.desks[name] = desk  # used last
                return desk
            folder = self.folder / name
            if not _NAME.fullmatch(name) or not (folder / FILE).is_file():
                raise InputError(f'there is no session {name!r}')
            desk = self._seat(name, LabSession.read(folder))
        desk.resume()
        return desk

    def sessions(self) -> list[dict[str, Any]]:
        """Sessions with steps, the latest first."""
        found = []
        for file in sorted(self.folder.glob(f'*/{FILE}'), reverse=True)[:50]:
            try:
                session = LabSession.read(file)
            except InputError:
                continue
            if session.steps:
                opened = session.opened
                found.append(
                    {
                        'name': file.parent.name,
                        'steps': len(session.steps),
                        'recordings': [
                            Path(path).name for path in (opened.recordings if opened else ())
                        ],
                        'effects': list(
                            dict.fromkeys(
                                e for s in session.done if s.kind == 'add' for e in s.effects
                            )
                        ),
                    }
                )
        return found

    def end(self) -> None:
        """Let all who wait for news go."""
        self.ending = True
        self.changed()
        self.streamed()

    def close(self) -> None:
        """End all workers."""
        for desk in self.desks.values():
            desk.close()

    def _seat(self, name: str, session: LabSession) -> Desk:
        while len(self.desks) >= _MOST_DESKS:
            idle: Sequence[str] = [n for n, d in self.desks.items() if not d.runner.busy]
            if not idle:
                raise InputError(f'{len(self.desks)} sessions are at work; wait for one of them')
            self.desks.pop(idle[0]).close()
        folder = self.folder / name
        desk = Desk(folder, session, lambda: self.changed(), lambda: self.streamed(), self.cache)
        desk.approved.update(self.approved)
        self.desks[name] = desk
        return desk
