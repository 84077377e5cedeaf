"""A thread with an owner: started, stopped, joined; its error is raised in the owner."""

import threading
from abc import ABC, abstractmethod


class Worker(ABC):
    """Base of a named thread that runs `_work` until it returns, raises, or sees `_stop` set."""

    def __init__(self, name: str) -> None:
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._error: BaseException | None = None

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop(self) -> None:
        """Ask the thread to end, without waiting for it."""
        self._stop.set()

    def join(self, timeout: float | None = None) -> bool:
        """Wait `timeout` s at most; return whether the thread has ended, or raise its error."""
        if self._thread.ident is not None:
            self._thread.join(timeout)
        if self._error is not None:
            raise self._error
        return not self._thread.is_alive()

    @property
    def failed(self) -> bool:
        """True if the thread has ended by an exception."""
        return self._error is not None

    def _run(self) -> None:
        try:
            self._work()
        except BaseException as error:
            self._error = error

    @abstractmethod
    def _work(self) -> None:
        """Do the work of the thread; return soon after `_stop` is set."""


class DeviceWorker(Worker):
    """Worker that serves a device and, after each loss, opens it again after a pause.

    The pause doubles with each loss from `first` to `last` s, and is `first` again once the device
    has given something.
    """

    def __init__(self, name: str, first: float, last: float) -> None:
        super().__init__(name)
        self._first_pause, self._last_pause = first, last

    def _work(self) -> None:
        pause = 0.0
        while not self._stop.is_set():
            before = self._given
            self._serve_once()
            is_first = not pause or self._given > before
            pause = self._first_pause if is_first else min(2 * pause, self._last_pause)
            self._stop.wait(pause)

    @property
    @abstractmethod
    def _given(self) -> int:
        """Number of things that the device has given so far."""

    @abstractmethod
    def _serve_once(self) -> None:
        """Open the device and serve it until it is lost or `_stop` is set."""
