"""Whether steps come when they should, and how long each takes."""

from collections import deque
from typing import Final

import numpy as np

_KEPT: Final = 3000  # steps; a minute at 50 Hz
_LATE: Final = 1.5  # periods


class Pace:
    """
    Counts periods in which no step came, and keeps what recent steps took.

    period: s between steps. A step that comes more than 1.5 periods after the one before has
    missed the periods between.
    """

    def __init__(self, period: float) -> None:
        self._period = period
        self._taken: deque[float] = deque(maxlen=_KEPT)
        self._last: float | None = None
        self.missed = 0
        self.steps = 0

    def begin(self, now: float) -> None:
        """A step begins at a time, s."""
        if self._last is not None and now - self._last > _LATE * self._period:
            self.missed += round((now - self._last) / self._period) - 1
        self._last = now

    def end(self, now: float) -> None:
        """Its command is sent."""
        if self._last is not None:
            self._taken.append(now - self._last)
            self.steps += 1

    def change(self, period: float) -> None:
        """Steps come at another rate from here on."""
        self._period, self._last = period, None

    def figures(self) -> dict[str, str]:
        """For diagnostics."""
        if not self._taken:
            return {'steps': '0'}
        median, high = 1e3 * np.quantile(self._taken, [0.5, 0.99])
        return {
            'steps': str(self.steps),
            'periods missed': str(self.missed),
            'observation to command, median [ms]': f'{median:.2f}',
            'observation to command, p99 [ms]': f'{high:.2f}',
        }
