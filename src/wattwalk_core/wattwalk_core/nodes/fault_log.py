"""Log of faults that come and go: each at most once in a while, none hidden by another."""

import re
import time
from typing import Any, Final, Protocol

_FIGURES: Final = re.compile(r'\b\d+(?:\.\d+)?\b')
_KINDS: Final = 8  # bounds the lines where the texts of faults are an attacker's


class LogTarget(Protocol):
    """Methods that a node's logger shares with one of Python's logging."""

    def warning(self, message: str) -> Any:
        """Log a fault."""

    def info(self, message: str) -> Any:
        """Log a message that is no fault."""


class FaultLog:
    """Passes each kind of warning on once in `period` s; texts that differ in figures are one."""

    def __init__(self, log: LogTarget, period: float = 10.0) -> None:
        self._log, self._period = log, period
        self._logged: dict[str, float] = {}
        self._open = True

    def warning(self, message: str) -> None:
        """Log a fault that begins or lasts."""
        now, kind = time.monotonic(), _FIGURES.sub('', message)
        self._logged = {k: at for k, at in self._logged.items() if now - at < self._period}
        if kind not in self._logged and len(self._logged) < _KINDS:
            self._logged[kind], self._open = now, True
            self._log.warning(message)

    def info(self, message: str) -> None:
        """Log the end of a fault, unless its beginning was left out."""
        if self._open:
            self._open = False
            self._log.info(message)
