"""Energy from a supply, and the balance of its power with that of the drives."""

import math
import threading
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.arrays import Floats

_S = 1_000_000_000
_WH = 3600.0
_LEAST_SPAN = 0.9
_LATE = 2
_BRIDGED = 10.0  # periods
_STEPPED = 10  # s back in time that restart the balance


@dataclass(frozen=True)
class Energy:
    """Energy from the supply in J (negative: returned), s counted, and s of gaps not counted."""

    joule: float = 0.0
    seconds: float = 0.0
    uncounted: float = 0.0

    @property
    def watt_hours(self) -> float:
        """The same in Wh."""
        return self.joule / _WH


class EnergyCounter:
    """Integral of power by the trapezoid rule.

    Nothing is counted between readings more than ten periods apart and next to NaN.
    """

    def __init__(self, period: float = 0.01) -> None:
        """period: s between readings; may be changed later."""
        self.period = period
        self._lock = threading.Lock()
        self._last: tuple[int, float] | None = None
        self._energy = Energy()

    def add(self, steady: int, power: float) -> None:
        """Add a reading: ns on the steady clock, W drawn; a clock that goes back adds nothing."""
        with self._lock:
            if self._last is not None:
                since, before = self._last
                span = (steady - since) / _S
                old = self._energy
                joule = 0.5 * (before + power) * span
                if 0.0 <= span <= _BRIDGED * self.period and math.isfinite(joule):
                    self._energy = Energy(old.joule + joule, old.seconds + span, old.uncounted)
                else:
                    self._energy = replace(old, uncounted=old.uncounted + max(span, 0.0))
            self._last = steady, power

    def total(self) -> Energy:
        """Return the energy since the last reset."""
        with self._lock:
            return self._energy

    def reset(self) -> Energy:
        """Set the counter to zero and return the energy until now."""
        with self._lock:
            counted, self._energy = self._energy, Energy()
            return counted


@dataclass(frozen=True)
class Balance:
    """Mean power over one second, W, of the supply and of all drives, which names lists."""

    supply: float
    drives: float
    rest_mean: float  # over the last `seconds`
    seconds: int
    names: Sequence[str]

    @property
    def rest(self) -> float:
        """Power of electronics and cables, with the errors of both meters, W."""
        return self.supply - self.drives


@dataclass
class _Mean:
    """Mean of power within one second, and the interval that the samples cover."""

    total: Floats | float = 0.0
    count: int = 0
    first: int = 0
    last: int = 0

    def add(self, stamp: int, last: int, power: Floats | float, count: int) -> None:
        """Add a sum over count samples that begin at stamp and end at last, ns."""
        self.first = stamp if not self.count else min(self.first, stamp)
        self.last = max(self.last, last)
        self.total = self.total + power
        self.count += count

    @property
    def whole(self) -> bool:
        """True if the samples cover nearly all of the second."""
        return self.last - self.first >= _LEAST_SPAN * _S

    @property
    def mean(self) -> Floats:
        """Mean over the samples."""
        return np.atleast_1d(self.total) / self.count


@dataclass
class _Second:
    """One second of ROS time: the supply, and drives by device."""

    supply: _Mean = field(default_factory=_Mean)
    drives: dict[tuple[str, tuple[str, ...]], _Mean] = field(default_factory=dict)


class PowerBalance:
    """Compares the power of the supply with the sum of the drives for each second of their stamps.

    Only seconds that both cover count. A drive that two devices measure counts once.
    """

    def __init__(self, seconds: int = 30) -> None:
        self._lock = threading.Lock()
        self._open: dict[int, _Second] = {}
        self._rests: deque[tuple[int, float]] = deque(maxlen=seconds)
        self._span = seconds
        self._balance: Balance | None = None

    def add_supply(self, stamp: int, power: float) -> None:
        """Add a reading of the supply: ROS time in ns, W drawn."""
        with self._lock:
            self._at(stamp).supply.add(stamp, stamp, power, 1)

    def add_drives(
        self, stamps: NDArray[np.int64], device: str, names: tuple[str, ...], power: Floats
    ) -> None:
        """Add good samples of a device: ROS time in ns [samples], W [samples, drives]."""
        seconds = stamps // _S
        with self._lock:
            for second in np.unique(seconds):
                rows = seconds == second
                times, part = stamps[rows], power[rows]
                mean = self._at(int(times[0])).drives.setdefault((device, names), _Mean())
                mean.add(int(times[0]), int(times[-1]), part.sum(axis=0), len(part))

    def _at(self, stamp: int) -> _Second:
        second = stamp // _S
        if second < max(self._open, default=second) - _STEPPED:
            self._open.clear()
            self._rests.clear()
        return self._open.setdefault(second, _Second())

    def report(self) -> Balance | None:
        """Return the newest balance; None if none of the last `seconds` has both sides."""
        with self._lock:
            newest = max(self._open, default=0)
            for second in sorted(s for s in self._open if s <= newest - _LATE):
                self._close(second, self._open.pop(second))
            while self._rests and self._rests[0][0] < newest - self._span - _LATE:
                self._rests.popleft()
            if not self._rests:
                self._balance = None
            return self._balance

    def _close(self, second: int, seen: _Second) -> None:
        by_name: dict[str, float] = {}
        for (_, names), mean in seen.drives.items():
            if mean.whole:
                for name, power in zip(names, mean.mean.tolist(), strict=True):
                    by_name.setdefault(name, power)
        if not seen.supply.whole or not by_name:
            return
        supply, drives = float(seen.supply.mean[0]), sum(by_name.values())
        self._rests.append((second, supply - drives))
        rests = [rest for _, rest in self._rests]
        self._balance = Balance(supply, drives, float(np.mean(rests)), len(rests), tuple(by_name))
