"""Timers on any clock."""

from collections.abc import Callable
from typing import Any

from rclpy.clock import Clock, ROSClock
from rclpy.exceptions import InvalidHandle


class Timer:
    """Calls back in a fixed period; missed periods are skipped. ValueError for a negative one."""

    def __init__(
        self,
        callback: Callable[[], Any] | None,
        timer_period_ns: int,
        clock: Clock,
        *,
        autostart: bool = True,
    ):
        if timer_period_ns < 0:
            raise ValueError('timer period must not be negative')
        self.callback = callback
        self.clock = clock
        self._period = int(timer_period_ns)
        self._canceled = not autostart
        self._destroyed = False
        self._last = clock.nanoseconds()
        self._next = self._last + self._period
        self._wake: Callable[[], None] | None = None

    @property
    def timer_period_ns(self) -> int:
        """Period in ns."""
        return self._period

    @timer_period_ns.setter
    def timer_period_ns(self, value: int) -> None:
        if value < 0:
            raise ValueError('timer period must not be negative')
        self._period = int(value)
        self._changed()

    def _changed(self) -> None:
        if self._destroyed:
            raise InvalidHandle
        if self._wake is not None:
            self._wake()

    def cancel(self) -> None:
        """Stop until reset."""
        self._canceled = True
        self._changed()

    def is_canceled(self) -> bool:
        """Tell whether the timer was cancelled."""
        return self._canceled

    def reset(self) -> None:
        """Start the period anew, also after cancel."""
        self._canceled = False
        self._next = self.clock.nanoseconds() + self._period
        self._changed()

    def destroy(self) -> None:
        """Stop for good."""
        self._destroyed = self._canceled = True

    def time_until_next_call(self) -> int | None:
        """Return the ns until the next call, negative where it is due; None if cancelled."""
        return None if self._canceled else self._next - self.clock.nanoseconds()

    def _follows_wall_time(self) -> bool:
        return not (isinstance(self.clock, ROSClock) and self.clock.ros_time_is_active)

    def _jumped(self) -> None:
        """Start the period anew after the clock was switched to another source of time."""
        self._last = self.clock.nanoseconds()
        self._next = self._last + self._period

    def _advance(self) -> bool:
        """Take note of a call that is due; return whether it is."""
        if self._canceled:
            return False
        now = self.clock.nanoseconds()
        if now < self._next:
            if now < self._last and not self._follows_wall_time():
                self._jumped()
            return False
        self._last = now
        self._next += self._period
        if self._next < now:
            behind = now - self._next
            periods = 1 + (behind - 1) // self._period if self._period else 0
            self._next = self._next + periods * self._period if periods else now
        return True
