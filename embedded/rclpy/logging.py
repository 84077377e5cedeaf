"""Loggers that write lines as ROS does: `[INFO] [seconds.nanoseconds] [name]: message`."""

import os
import sys
import threading
import time
from collections.abc import Callable
from enum import IntEnum
from typing import Any, TypeAlias

DEFAULT_FORMAT = '[{severity}] [{time}] [{name}]: {message}'
COLOURS = {'DEBUG': '32', 'WARN': '33', 'ERROR': '31', 'FATAL': '31'}


class LoggingSeverity(IntEnum):
    """Severities of messages; a logger with UNSET takes that of its parent."""

    UNSET = 0
    DEBUG = 10
    INFO = 20
    WARN = 30
    ERROR = 40
    FATAL = 50


_levels: dict[str, LoggingSeverity] = {'': LoggingSeverity.INFO}
_loggers: dict[str, 'RcutilsLogger'] = {}
_lock = threading.Lock()


def set_logger_level(name: str, level: int) -> None:
    """Set the lowest severity that a logger writes; the name '' is the root."""
    _levels[name] = LoggingSeverity(level)


def get_logger_effective_level(name: str) -> LoggingSeverity:
    """Return the severity of a logger or of its nearest ancestor that has one."""
    while name:
        level = _levels.get(name, LoggingSeverity.UNSET)
        if level is not LoggingSeverity.UNSET:
            return level
        name = name.rpartition('.')[0]
    return _levels[''] or LoggingSeverity.INFO


def get_logger(name: str) -> 'RcutilsLogger':
    """Return the logger of this name; ValueError for an empty one."""
    if not name:
        raise ValueError('Logger name must not be empty.')
    return _loggers.setdefault(name, RcutilsLogger(name))


Place: TypeAlias = tuple[str, int, str, int]


def _place() -> Place:
    """Return what tells one call in the code that uses this module from all others."""
    frame = sys._getframe(2)
    while frame.f_code.co_filename == __file__ and frame.f_back is not None:
        frame = frame.f_back
    code = frame.f_code
    return (code.co_filename, frame.f_lineno, code.co_name, frame.f_lasti)


def _write(severity: LoggingSeverity, name: str, message: str) -> None:
    seconds, nanoseconds = divmod(time.time_ns(), 1_000_000_000)
    line = os.environ.get('RCUTILS_CONSOLE_OUTPUT_FORMAT', DEFAULT_FORMAT)
    line = line.replace('{severity}', severity.name).replace('{name}', name)
    line = line.replace('{time}', f'{seconds}.{nanoseconds:09d}').replace('{message}', message)
    wish = os.environ.get('RCUTILS_COLORIZED_OUTPUT')
    if severity.name in COLOURS and (wish == '1' or (wish is None and sys.stderr.isatty())):
        line = f'\033[{COLOURS[severity.name]}m{line}\033[0m'
    with _lock:
        print(line, file=sys.stderr, flush=True)


def _at(severity: LoggingSeverity) -> Callable[..., bool]:
    """Make the method that writes at a severity; like all here, it is not the place of a call."""

    def method(self: 'RcutilsLogger', message: object, **kwargs: Any) -> bool:
        return self.log(message, severity, **kwargs)

    return method


class RcutilsLogger:
    """Writes messages to stderr, all of them or, with options, only some."""

    def __init__(self, name: str = ''):
        self.name = name
        self._seen: dict[Place, int] = {}
        self._severities: dict[Place, LoggingSeverity] = {}

    def set_level(self, level: int) -> None:
        """Set the lowest severity that this logger writes."""
        set_logger_level(self.name, level)

    def log(
        self,
        message: object,
        severity: int,
        *,
        once: bool = False,
        throttle_duration_sec: float | None = None,
        throttle_time_source_type: Any = None,
    ) -> bool:
        """Write a message, unless a level or option suppresses it; return whether it was written.

        `once` and `throttle_duration_sec` [s] count for each place in the code.
        Raises ValueError where one place logs at different severities, as rclpy does.
        """
        level = LoggingSeverity(severity)
        if level < get_logger_effective_level(self.name):
            return False
        place = _place()
        if self._severities.setdefault(place, level) is not level:
            raise ValueError('Logger severity cannot be changed between calls.')
        limited = once or throttle_duration_sec is not None
        if limited and not self._is_due(
            place, once, throttle_duration_sec or 0.0, throttle_time_source_type
        ):
            return False
        _write(level, self.name, str(message))
        return True

    def _is_due(self, place: Place, once: bool, throttle: float, source: Any) -> bool:
        last = self._seen.get(place)
        now = time.monotonic_ns() if source is None else source.now().nanoseconds
        if last is not None and (once or 0 <= now - last < throttle * 1e9):
            return False
        self._seen[place] = now
        return True

    debug = _at(LoggingSeverity.DEBUG)
    info = _at(LoggingSeverity.INFO)
    warning = warn = _at(LoggingSeverity.WARN)
    error = _at(LoggingSeverity.ERROR)
    fatal = _at(LoggingSeverity.FATAL)
