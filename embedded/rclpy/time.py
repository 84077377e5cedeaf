"""Points in time of nanosecond resolution, each on one kind of clock."""

from functools import total_ordering
from typing import Any, overload

from builtin_interfaces.msg import Time as TimeMsg

from rclpy.clock_type import ClockType
from rclpy.duration import Duration


@total_ordering
class Time:
    """A point in time; times of different clocks do not compare."""

    __slots__ = ('clock_type', 'nanoseconds')

    def __init__(
        self,
        *,
        seconds: int | float = 0,
        nanoseconds: int | float = 0,
        clock_type: ClockType = ClockType.SYSTEM_TIME,
    ):
        if not isinstance(clock_type, ClockType):
            raise TypeError('Clock type must be a ClockType enum')
        if seconds < 0:
            raise ValueError('Seconds value must not be negative')
        if nanoseconds < 0:
            raise ValueError('Nanoseconds value must not be negative')
        total = int(seconds * 1_000_000_000) + int(nanoseconds)
        if total >= 2**63:
            raise OverflowError('Total nanoseconds value is too large to store in C time point.')
        self.nanoseconds: int = total
        self.clock_type = clock_type

    def __repr__(self) -> str:
        return f'Time(nanoseconds={self.nanoseconds}, clock_type={self.clock_type.name})'

    def __hash__(self) -> int:
        return hash((self.nanoseconds, self.clock_type))

    def __add__(self, other: Duration) -> 'Time':
        if not isinstance(other, Duration):
            return NotImplemented
        total = self.nanoseconds + other.nanoseconds
        if total >= 2**63:
            raise OverflowError('Addition leads to overflow in C storage.')
        return Time(nanoseconds=total, clock_type=self.clock_type)

    __radd__ = __add__

    @overload
    def __sub__(self, other: 'Time') -> Duration: ...
    @overload
    def __sub__(self, other: Duration) -> 'Time': ...
    def __sub__(self, other: Any) -> Any:
        if isinstance(other, Time):
            self._same_clock(other, 'subtract')
            return Duration(nanoseconds=self.nanoseconds - other.nanoseconds)
        if isinstance(other, Duration):
            total = self.nanoseconds - other.nanoseconds
            if total < 0:
                raise ValueError('Subtraction leads to negative time')
            return Time(nanoseconds=total, clock_type=self.clock_type)
        return NotImplemented

    def _same_clock(self, other: 'Time', verb: str) -> None:
        if self.clock_type != other.clock_type:
            raise TypeError(f"Can't {verb} times with different clock types")

    def __eq__(self, other: object) -> bool:
        if isinstance(other, Time):
            self._same_clock(other, 'compare')
            return self.nanoseconds == other.nanoseconds
        return False

    def __lt__(self, other: 'Time') -> bool:
        if isinstance(other, Time):
            self._same_clock(other, 'compare')
            return self.nanoseconds < other.nanoseconds
        return NotImplemented

    def to_msg(self) -> Any:
        """Return the time as builtin_interfaces/Time."""
        seconds, nanoseconds = divmod(self.nanoseconds, 1_000_000_000)
        return TimeMsg(sec=seconds, nanosec=nanoseconds)

    @classmethod
    def from_msg(cls, msg: Any, clock_type: ClockType = ClockType.ROS_TIME) -> 'Time':
        """Make a time of builtin_interfaces/Time."""
        if not isinstance(msg, TimeMsg):
            raise TypeError('Must pass a builtin_interfaces.msg.Time object')
        return cls(nanoseconds=msg.sec * 1_000_000_000 + msg.nanosec, clock_type=clock_type)
