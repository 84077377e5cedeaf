"""Durations of nanosecond resolution."""

from functools import total_ordering
from typing import Any

from builtin_interfaces.msg import Duration as DurationMsg


@total_ordering
class Duration:
    """A signed span of time."""

    __slots__ = ('nanoseconds',)

    def __init__(self, *, seconds: int | float = 0, nanoseconds: int | float = 0):
        total = int(seconds * 1_000_000_000) + int(nanoseconds)
        if not -(2**63) <= total < 2**63:
            raise OverflowError('Total nanoseconds value is too large to store in C duration.')
        self.nanoseconds: int = total

    def __repr__(self) -> str:
        return f'Duration(nanoseconds={self.nanoseconds})'

    def __str__(self) -> str:
        if self == Infinite:
            return 'Infinite'
        return f'{self.nanoseconds} nanoseconds'

    def __hash__(self) -> int:
        return hash(self.nanoseconds)

    def __eq__(self, other: object) -> bool:
        if isinstance(other, Duration):
            return self.nanoseconds == other.nanoseconds
        return NotImplemented

    def __lt__(self, other: 'Duration') -> bool:
        if isinstance(other, Duration):
            return self.nanoseconds < other.nanoseconds
        return NotImplemented

    def to_msg(self) -> Any:
        """Return the duration as builtin_interfaces/Duration."""
        seconds, nanoseconds = divmod(self.nanoseconds, 1_000_000_000)
        return DurationMsg(sec=seconds, nanosec=nanoseconds)

    @classmethod
    def from_msg(cls, msg: Any) -> 'Duration':
        """Make a duration of builtin_interfaces/Duration."""
        return cls(nanoseconds=msg.sec * 1_000_000_000 + msg.nanosec)


Infinite = Duration(nanoseconds=2**63 - 1)
