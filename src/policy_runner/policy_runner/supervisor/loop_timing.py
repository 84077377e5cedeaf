"""Loop timing: missed periods and duration of the steps of a control loop."""

from collections import deque
from typing import Final

import numpy as np

_KEPT: Final = 3000  # steps; a minute at 50 Hz
_LATE: Final = 1.5  # periods


class LoopTiming:
    """
    Counter of missed periods, with the durations of recent steps.

    period: s between steps. A step that begins over 1.5 periods after the last one has missed the
    periods between.
    """

    def __init__(self, period: float) -> None:
        self._period = period
        self._durations: deque[float] = deque(maxlen=_KEPT)
        self._last: float | None = None
        self.missed = 0
        self.steps = 0

    def begin(self, now: float) -> None:
        """Record the beginning of a step, s."""
        if self._last is not None and now - self._last > _LATE * self._period:
            self.missed += round((now - self._last) / self._period) - 1
        self._last = now

    def end(self, now: float) -> None:
        """Record the end of a step, s: its command is sent."""
        if self._last is not None:
            self._durations.append(now - self._last)
            self.steps += 1

    def change(self, period: float) -> None:
        """Set another period, s."""
        self._period, self._last = period, None

    def figures(self) -> dict[str, str]:
        """Return values for diagnostics, by name."""
        if not self._durations:
            return {'steps': '0'}
        median, high = 1e3 * np.quantile(self._durations, [0.5, 0.99])
        return {
            'steps': str(self.steps),
            'periods missed': str(self.missed),
            'observation to command, median [ms]': f'{median:.2f}',
            'observation to command, p99 [ms]': f'{high:.2f}',
        }
