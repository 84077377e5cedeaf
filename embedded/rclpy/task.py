"""Futures: results that come later."""

import threading
from collections.abc import Callable
from typing import Any


class Future:
    """A result or exception that is set later, by another callback or thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._done = False
        self._result: Any = None
        self._exception: BaseException | None = None
        self._callbacks: list[Callable[[Future], None]] = []

    def done(self) -> bool:
        """Return whether a result or exception is set."""
        return self._done

    def result(self) -> Any:
        """Return the result, raise the exception, or None where there is none yet."""
        if self._exception is not None:
            raise self._exception
        return self._result

    def set_result(self, result: Any) -> None:
        """Set the result and call the callbacks."""
        self._finish(result=result)

    def set_exception(self, exception: BaseException) -> None:
        """Set an exception and call the callbacks."""
        self._finish(exception=exception)

    def _finish(self, result: Any = None, exception: BaseException | None = None) -> None:
        with self._lock:
            if self._done:
                return
            self._result, self._exception, self._done = result, exception, True
            callbacks, self._callbacks = self._callbacks, []
        for callback in callbacks:
            callback(self)

    def add_done_callback(self, callback: Callable[['Future'], None]) -> None:
        """Register a callback for when the future is done; called at once if it is."""
        with self._lock:
            if not self._done:
                self._callbacks.append(callback)
                return
        callback(self)
