"""Shapes of amplitude 1 over time: sine, chirp, and sequences of levels."""

from math import inf, log, pi, sin
from typing import Final

SHAPES: Final = ('sine', 'square', 'chirp', 'ladder', 'hold')
_LADDER: Final = (0.25, -0.25, 0.5, -0.5, 0.75, -0.75, 1.0, -1.0, 0.0)
_RUNG: Final = 2.0  # s


class Oscillation:
    """
    Sine of `frequency` (Hz), or a chirp from `lowest` to it within `seconds`.

    It fades in and out within a period, unless it is abrupt.
    """

    def __init__(
        self, frequency: float, seconds: float, lowest: float = 0.0, abrupt: bool = False
    ) -> None:
        self._frequency, self._seconds, self._lowest = frequency, seconds, lowest
        self._abrupt = abrupt
        self._all = self.turns(seconds)

    def turns(self, time: float) -> float:
        """Return the periods since the start."""
        if not self._lowest or self._lowest == self._frequency:
            return self._frequency * time
        rate = self._frequency / self._lowest
        share = rate ** (time / self._seconds) - 1.0
        return self._lowest * self._seconds * share / log(rate)

    def at(self, time: float) -> float:
        """Return the value at a time, s."""
        turns = self.turns(time)
        share = 1.0 if self._abrupt else max(0.0, min(1.0, turns, self._all - turns))
        return share * sin(2.0 * pi * turns)


class LevelSequence:
    """Levels of -1 to 1, each held for `rung` seconds: square, ladder or hold."""

    def __init__(self, shape: str, frequency: float) -> None:
        self.levels = {'square': (1.0, -1.0), 'ladder': _LADDER, 'hold': (1.0,)}[shape]
        self.rung = {'square': 0.5 / frequency if frequency else inf, 'ladder': _RUNG}.get(
            shape, inf
        )

    def at(self, time: float) -> tuple[float, float, float]:
        """Return the previous level (0 before the first), the present one and its age, s."""
        count = int(time / self.rung)
        before = self.levels[(count - 1) % len(self.levels)] if count else 0.0
        within = time - count * self.rung if count else time
        return before, self.levels[count % len(self.levels)], within

    @property
    def widest(self) -> float:
        """Largest change from one level to the next."""
        after = (*self.levels, self.levels[0])
        return max(abs(b - a) for a, b in zip((0.0, *self.levels), after, strict=True))
