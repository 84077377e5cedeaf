"""Slots of a fixed period on the steady clock, and the loss of those without a sample."""

import time
from collections.abc import Iterator
from threading import Event


class Slots:
    """
    Slots of `period` s, counted from the first use of `each`.

    A slot that is missed is not made up for: the next one is the first that begins from now on.
    """

    def __init__(self, period: float) -> None:
        self.period = period
        self._start: float | None = None
        self._lost = 0

    def each(self, stop: Event) -> Iterator[int]:
        """Yield the index of each slot when it begins, until `stop` is set."""
        if self._start is None:
            self._start = time.monotonic()
        slot = self._next()
        while not stop.wait(self._start + slot * self.period - time.monotonic()):
            yield slot
            slot = max(slot + 1, self._next())

    def _next(self) -> int:
        return -int(-self._elapsed() // self.period)

    def _elapsed(self) -> float:
        return 0.0 if self._start is None else time.monotonic() - self._start

    def lost(self, samples: int) -> int:
        """Return the number of slots that have ended without one of so many samples."""
        self._lost = max(self._lost, int(self._elapsed() / self.period) - 1 - samples)
        return self._lost


class Pauses:
    """Pauses between attempts: each twice the one before, from `first` to `last` s."""

    def __init__(self, first: float, last: float) -> None:
        self._first, self._last = first, last
        self._next = first

    def wait(self, stop: Event) -> None:
        """Wait for the next pause, or until `stop` is set."""
        stop.wait(self._next)
        self._next = min(2 * self._next, self._last)

    def reset(self) -> None:
        """Begin with the first pause again."""
        self._next = self._first
