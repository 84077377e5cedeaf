"""Queries that are sent to polled devices, a round of them each period."""

import time
from collections.abc import Sequence

import can


class QueryRounds:
    """
    Sends the same frames each `period` s, from the thread that reads the bus.

    A round that is late is not made up for. A frame that the bus does not take is counted as
    unsent: without a device that acknowledges, the queue of the interface is full.
    """

    def __init__(self, queries: Sequence[can.Message], period: float) -> None:
        self._queries = queries
        self._period = period
        self._next = 0.0
        self.sent = self.unsent = 0

    def send_due(self, bus: can.BusABC) -> float:
        """Send a round if it is due; return the time in s until the next one."""
        now = time.monotonic()
        if now >= self._next:
            for query in self._queries:
                try:
                    bus.send(query, timeout=0)
                    self.sent += 1
                except can.CanOperationError:
                    self.unsent += 1
            self._next += self._period
            if self._next <= now:
                self._next = now + self._period
        return self._next - now
