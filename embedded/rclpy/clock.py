"""Clocks."""

import time
from typing import Any

from rclpy.clock_type import ClockType
from rclpy.time import Time


class Clock:
    """A clock of the kind asked for; `Clock(clock_type=ClockType.ROS_TIME)` is a ROSClock."""

    clock_type: ClockType

    def __new__(  # noqa: D102
        cls, *, clock_type: ClockType = ClockType.SYSTEM_TIME
    ) -> 'Clock':
        if not isinstance(clock_type, ClockType):
            raise TypeError('Clock type must be a ClockType enum')
        kind: Any = ROSClock if clock_type is ClockType.ROS_TIME else cls
        self = object.__new__(kind)
        self.clock_type = clock_type
        return self

    def __init__(self, *, clock_type: ClockType = ClockType.SYSTEM_TIME):
        pass

    def nanoseconds(self) -> int:
        """Return the time now in ns."""
        if self.clock_type is ClockType.STEADY_TIME:
            return time.monotonic_ns()
        return time.time_ns()

    def now(self) -> Time:
        """Return the time now."""
        now = object.__new__(Time)
        now.nanoseconds = self.nanoseconds()
        now.clock_type = self.clock_type
        return now


class ROSClock(Clock):
    """System time, or the time of /clock while that is active."""

    _simulated: int | None = None

    def __new__(cls, **_: Any) -> Any:  # noqa: D102
        return super().__new__(cls, clock_type=ClockType.ROS_TIME)

    @property
    def ros_time_is_active(self) -> bool:
        """True if the time comes from /clock."""
        return self._simulated is not None

    def _set_ros_time_is_active(self, enabled: bool) -> None:
        self._simulated = (self._simulated or 0) if enabled else None

    def set_ros_time_override(self, value: Time) -> None:
        """Set the time that `now` returns while the time of /clock is active."""
        if not isinstance(value, Time):
            raise TypeError('Time must be specified as rclpy.time.Time.')
        if self._simulated is not None:
            self._simulated = value.nanoseconds

    def nanoseconds(self) -> int:
        """Return the time now in ns."""
        return time.time_ns() if self._simulated is None else self._simulated
