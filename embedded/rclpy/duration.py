"""Durations of nanosecond resolution."""

from dataclasses import dataclass
from typing import Any

from builtin_interfaces.msg import Duration as DurationMsg


@dataclass(init=False, order=True, unsafe_hash=True, slots=True)
class Duration:
    """A signed span of time."""

    nanoseconds: int

    def __init__(self, *, seconds: int | float = 0, nanoseconds: int | float = 0):
        self.nanoseconds = int(seconds * 1_000_000_000) + int(nanoseconds)
        if not -(2**63) <= self.nanoseconds < 2**63:
            raise OverflowError('Total nanoseconds value is too large to store in C duration.')

    def __str__(self) -> str:
        return 'Infinite' if self == Infinite else f'{self.nanoseconds} nanoseconds'

    def to_msg(self) -> Any:
        """Return the duration as builtin_interfaces/Duration."""
        seconds, nanoseconds = divmod(self.nanoseconds, 1_000_000_000)
        return DurationMsg(sec=seconds, nanosec=nanoseconds)

    @classmethod
    def from_msg(cls, msg: Any) -> 'Duration':
        """Make a duration of builtin_interfaces/Duration."""
        return cls(nanoseconds=msg.sec * 1_000_000_000 + msg.nanosec)


Infinite = Duration(nanoseconds=2**63 - 1)
