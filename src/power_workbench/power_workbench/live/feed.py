"""The live view of one session: its process, and the latest of its news for those who follow."""

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

from wattwalk_core.errors import InputError

from power_workbench.piped_process import PipedProcess

_BACKLOG = 320  # messages, half a minute of them
_LONELY = 10.0  # s without anybody who follows, after which the process ends
_PATIENCE = 2.0  # s for the process to end by itself
_ENDED = {'failed': 'the live view ended unexpectedly; follow anew'}


class LiveFeed(PipedProcess):
    """Process of the live view, which runs while somebody follows, and its latest messages.

    Methods may be called from any thread; `changed` is called in a separate one at each message.
    """

    def __init__(self, changed: Callable[[], None]) -> None:
        super().__init__('power_workbench.live.process', _PATIENCE)
        self._changed = changed
        self._news: deque[dict[str, Any]] = deque(maxlen=_BACKLOG)
        self._count = self._following = 0
        self._left = 0.0
        self._used: tuple[str, tuple[str, ...]] | None = None

    def has_more(self, count: int) -> bool:
        """Return whether more than the first `count` messages have come."""
        return self._count > count

    @property
    def recorder(self) -> str:
        """Folder of the recording that is being written, '' for none."""
        with self._lock:
            return str(self._news[-1].get('recorder', '')) if self._news else ''

    def after(self, count: int) -> tuple[int, list[dict[str, Any]]]:
        """Return the number of messages so far, and those after the first `count`, if kept."""
        with self._lock:
            new = min(self._count - count, len(self._news))
            return self._count, list(self._news)[len(self._news) - new :] if new > 0 else []

    def join(self) -> None:
        """Count one more follower; start the process where none runs."""
        with self._lock:
            self._following += 1
            if self._start():
                self._news.clear()
                self._used = None

    def leave(self) -> None:
        """Count one follower less; the process ends 10 s after the last one left."""
        with self._lock:
            self._following -= 1
            self._left = time.monotonic()

    def use(self, spec: str, effect_files: Sequence[str]) -> None:
        """Estimate with the model `spec`; '' for what the nodes publish."""
        with self._lock:
            wanted = (spec, tuple(effect_files))
            if self._pipe is not None and wanted != self._used:
                self._used = wanted
                with suppress(OSError):
                    self._pipe.send(('use', *wanted))

    def note(self, text: str) -> None:
        """Publish a note for recorders; InputError while nothing is followed."""
        with self._lock:
            if self._pipe is None:
                raise InputError('nothing is followed; press “Follow the running robot” first')
            try:
                self._pipe.send(('note', text))
            except OSError as error:
                raise InputError('the live view has ended; follow anew') from error

    def close(self) -> None:
        """End the process."""
        with self._lock:
            self._stop()

    def _heard(self, pipe: Connection, message: dict[str, Any] | None) -> None:
        with self._lock:
            if pipe is not self._pipe:
                return
            if message is None and self._news and 'failed' in self._news[-1]:
                return
            self._news.append(_ENDED if message is None else message)
            self._count += 1
            lonely = not self._following and time.monotonic() - self._left > _LONELY
            if lonely:
                threading.Thread(target=self._end_if_lonely, daemon=True).start()
        self._changed()

    def _end_if_lonely(self) -> None:
        with self._lock:
            if not self._following:
                self._stop()
