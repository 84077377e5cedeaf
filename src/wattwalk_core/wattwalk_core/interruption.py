"""SIGINT and SIGTERM in commands: files are closed before the end."""

import signal
import threading
from types import FrameType
from typing import Any, Final, Self

from wattwalk_core.early import send_again

_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM)


class Interrupted(KeyboardInterrupt):
    """End by a signal; the message, if any, is one line for the user."""

    def __init__(self, number: signal.Signals, message: str = '') -> None:
        super().__init__(message)
        self.number = number


class RaisedSignals:
    """SIGINT and SIGTERM as the exception Interrupted, within a `with` block of the main thread.

    received: the last one. In other threads the handlers stay as they are. A signal that comes
    while a module is imported is raised after the import: extension modules turn an exception
    into an ImportError of their own, and callbacks of the import system lose it.
    """

    def __init__(self) -> None:
        self.received: signal.Signals | None = None
        self._former: dict[signal.Signals, Any] = {}

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            self._former = {number: signal.signal(number, self._handle) for number in _SIGNALS}
        return self

    def __exit__(self, *_: object) -> None:
        for number, former in self._former.items():
            # A node that a signal has ended leaves the next ones ignored.
            if signal.getsignal(number) == self._handle:
                signal.signal(number, former)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        self.received = signal.Signals(number)
        if _importing(frame):
            send_again(number)
        else:
            raise Interrupted(self.received)


def _importing(frame: FrameType | None) -> bool:
    """Return whether a frame, or a caller of it, is importing a module."""
    while frame is not None:
        if frame.f_code.co_filename.startswith('<frozen importlib'):
            return True
        frame = frame.f_back
    return False


class DeferredSignals(RaisedSignals):
    """The same, but the first signal is only noted, for loops that must end between two writes."""

    def _handle(self, number: int, frame: FrameType | None) -> None:
        if self.received is not None:
            super()._handle(number, frame)
        self.received = signal.Signals(number)
