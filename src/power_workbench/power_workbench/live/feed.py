"""The live view of one session: its process, and the latest of its news for those who follow."""

import os
import socket
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

from wattwalk_core.errors import InputError

_BACKLOG = 320  # messages, half a minute of them
_LONELY = 10.0  # s without anybody who follows, after which the process ends
_PATIENCE = 2.0  # s for the process to end by itself
_ENDED = {'failed': 'the live view ended unexpectedly; follow anew'}


class LiveFeed:
    """Process of the live view, which runs while somebody follows, and its latest messages.

    Methods may be called from any thread; `changed` is called in a separate one at each message.
    """

    def __init__(self, changed: Callable[[], None]) -> None:
        self._changed = changed
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._pipe: Connection | None = None
        self._news: deque[dict[str, Any]] = deque(maxlen=_BACKLOG)
        self._count = self._following = 0
        self._left = 0.0
        self._used: tuple[str, tuple[str, ...]] | None = None

    def has_more(self, count: int) -> bool:
        """Return whether more than the first `count` messages have come."""
        return self._count > count

    @property
    def pid(self) -> int | None:
        """Process id, None while there is no process."""
        return None if self._process is None else self._process.pid

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
            if self._process is None or self._process.poll() is not None:
                self._start()

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

    def _start(self) -> None:
        self._stop()
        self._news.clear()
        own, other = socket.socketpair()
        with other:
            self._process = subprocess.Popen(
                [sys.executable, '-m', 'power_workbench.live.process', str(other.fileno())],
                pass_fds=[other.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                start_new_session=True,
            )
        self._pipe, self._used = Connection(own.detach()), None
        arguments = (self._pipe, self._process)
        threading.Thread(target=self._listen, args=arguments, daemon=True).start()

    def _stop(self) -> None:
        process, pipe, self._process, self._pipe = self._process, self._pipe, None, None
        if pipe is not None:
            # The thread that reads from it ends by itself, as the node does.
            _hang_up(pipe)
        if process is not None:
            try:
                process.wait(_PATIENCE)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    def _listen(self, pipe: Connection, process: 'subprocess.Popen[bytes]') -> None:
        try:
            while True:
                self._heard(pipe, pipe.recv())
        except (EOFError, OSError):
            self._heard(pipe, _ENDED)
        finally:
            with suppress(OSError):
                pipe.close()
            process.wait()

    def _heard(self, pipe: Connection, message: dict[str, Any]) -> None:
        with self._lock:
            if pipe is not self._pipe:
                return
            if message is _ENDED and self._news and 'failed' in self._news[-1]:
                return
            self._news.append(message)
            self._count += 1
            lonely = not self._following and time.monotonic() - self._left > _LONELY
            if lonely:
                threading.Thread(target=self._end_if_lonely, daemon=True).start()
        self._changed()

    def _end_if_lonely(self) -> None:
        with self._lock:
            if not self._following:
                self._stop()


def _hang_up(pipe: Connection) -> None:
    """Shut a pipe down from which a thread may be reading."""
    with suppress(OSError):
        link = socket.socket(fileno=os.dup(pipe.fileno()))
        link.shutdown(socket.SHUT_RDWR)
        link.close()
