"""Means of whole seconds of what was measured, estimated and moved, by their stamps."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Doubles = NDArray[np.float64]

_SECOND = 1_000_000_000  # ns
_LEAST_ESTIMATES = 0.8  # of a second's
_LEAST_SAMPLES = 20  # of the measured power
_MOST_WAITING = 10  # seconds that are not complete


@dataclass
class _Sums:
    power: Doubles  # W [D]
    motion: Doubles  # [D, 3]: |ω|, ω², τ²
    estimate: Doubles  # W [D]
    samples: int = 0
    states: int = 0
    estimates: int = 0


@dataclass
class SecondMeans:
    """
    Sums by second of D drives, until each stream has passed it.

    rate: estimates per second.
    """

    drives: int
    rate: float
    _sums: dict[int, _Sums] = field(default_factory=dict)
    _measured: int = -1
    _estimated: int = -1

    def measured(self, stamp: int, power: Doubles) -> None:
        """Take measured power [samples, D], W, without NaN."""
        sums = self._of(stamp)
        self._measured = max(self._measured, stamp // _SECOND)
        if sums is not None:
            sums.power += power.sum(axis=0)
            sums.samples += len(power)

    def moved(self, stamp: int, velocity: Doubles, torque: Doubles) -> None:
        """Take speed [D], rad/s, and torque [D], N·m."""
        sums = self._of(stamp)
        if sums is not None:
            sums.motion += np.stack([np.abs(velocity), velocity**2, torque**2], axis=1)
            sums.states += 1

    def estimated(self, stamp: int, power: Doubles) -> None:
        """Take an estimate [D], W, that may be relied on."""
        sums = self._of(stamp)
        self._estimated = max(self._estimated, stamp // _SECOND)
        if sums is not None:
            sums.estimate += power
            sums.estimates += 1

    def complete(self) -> Iterator[tuple[int, Doubles, Doubles]]:
        """Yield index, measured − estimated [D] and 1, |ω|, ω², τ², P [D, 5] of past seconds."""
        passed = min(self._measured, self._estimated)
        for index in sorted(i for i in self._sums if i < passed):
            sums = self._sums.pop(index)
            if sums.samples < _LEAST_SAMPLES or sums.estimates < _LEAST_ESTIMATES * self.rate:
                continue
            if not sums.states:
                continue
            estimate = sums.estimate / sums.estimates
            difference = sums.power / sums.samples - estimate
            ones = np.ones((self.drives, 1))
            motion = sums.motion / sums.states
            yield index, difference, np.concatenate([ones, motion, estimate[:, None]], axis=1)

    def _of(self, stamp: int) -> _Sums | None:
        """Return the sums of a stamp's second; None for one that is long past."""
        index = stamp // _SECOND
        if index not in self._sums:
            if index <= min(self._measured, self._estimated) - _MOST_WAITING:
                return None
            zero = np.zeros(self.drives)
            self._sums[index] = _Sums(zero.copy(), np.zeros((self.drives, 3)), zero.copy())
            if len(self._sums) > _MOST_WAITING:
                del self._sums[min(self._sums)]
        return self._sums[index]
