"""Reports on a node or a part of it, on the topic `diagnostics` and in the log."""

import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Final, Protocol

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

_FIGURES: Final = re.compile(r'\b\d+(?:\.\d+)?\b')
_NAMED: Final = 4  # in a sentence
_KINDS: Final = 8  # bounds the lines where the texts of faults are an attacker's


class LogTarget(Protocol):
    """Methods that a node's logger shares with one of Python's logging."""

    def warning(self, message: str) -> Any:
        """Log a fault."""

    def info(self, message: str) -> Any:
        """Log a message that is no fault."""


class FaultLog:
    """Log that lets each kind of warning, whatever its numbers, through once in `period` s."""

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


class Level(IntEnum):
    """Levels of diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2


@dataclass(frozen=True)
class Report:
    """Diagnostic report: level, a sentence that gives the reason, and figures by name."""

    level: Level
    sentence: str
    figures: Mapping[str, object]


class Reporter:
    """Publishes the reports on a node, or on one part of it under the name `node: part`.

    hardware_id: name or address of the device that the reports are about, where there is one.
    """

    def __init__(self, node: Node, part: str = '', hardware_id: str = '') -> None:
        self._node, self._hardware = node, hardware_id
        self._name = f'{node.get_name()}: {part}' if part else node.get_name()
        self._publisher = node.create_publisher(DiagnosticArray, 'diagnostics', 10)
        self._faults = FaultLog(node.get_logger())
        self._level = Level.OK

    def say(self, report: Report) -> None:
        """Publish a report; log a fault when it begins and ends, and once in 10 s between."""
        if report.level is not Level.OK:
            self._faults.warning(report.sentence)
        elif self._level is not Level.OK:
            self._faults.info(report.sentence)
        self._level = report.level
        self.publish(report)

    def publish(self, report: Report) -> None:
        """Publish a report, and log nothing."""
        status = DiagnosticStatus(
            level=bytes([report.level]),
            name=self._name,
            message=report.sentence,
            hardware_id=self._hardware,
            values=[KeyValue(key=key, value=str(value)) for key, value in report.figures.items()],
        )
        message = DiagnosticArray(status=[status])
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)


def faults(news: Mapping[str, float], is_fault: Callable[[str], bool]) -> str:
    """Return the fault counters that rose as text, such as `3 late, 1 lost`; '' where none did.

    news: change of each counter; is_fault: says whether the counter of that name counts faults.
    """
    return ', '.join(f'{n:.0f} {name}' for name, n in news.items() if n > 0 and is_fault(name))


def some(names: Sequence[str]) -> str:
    """Return the first of different names, and how many more there are."""
    chosen = list(dict.fromkeys(names))
    more = f' and {len(chosen) - _NAMED} more' if len(chosen) > _NAMED else ''
    return ', '.join(chosen[:_NAMED]) + more


class CountChanges:
    """Changes of named counters from one report to the next."""

    def __init__(self) -> None:
        self._before: Mapping[str, float] = {}
        self._time: float | None = None

    def since_last(
        self, counts: Mapping[str, float], now: float
    ) -> tuple[dict[str, float], float]:
        """Return the change of each counter since the last call and the time in s since then.

        now: s on a steady clock. The first call returns the counts themselves, and 0 s.
        """
        news = {name: count - self._before.get(name, 0) for name, count in counts.items()}
        span = 0.0 if self._time is None else now - self._time
        self._time, self._before = now, counts
        return news, span
