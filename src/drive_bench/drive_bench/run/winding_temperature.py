"""Winding temperatures by drive, with their ages."""

import math
from collections.abc import Sequence
from typing import Final

from policy_runner.supervisor.safety import Fault, FaultKind

STALE_AFTER: Final = 2.0  # s


class WindingTemperature:
    """Latest winding temperature of each drive, °C, with its time of arrival, s."""

    def __init__(self) -> None:
        self._read: dict[str, tuple[float, float]] = {}

    def on_supply(self, names: Sequence[str], celsius: Sequence[float], now: float) -> None:
        """Take temperatures of drive_supply: one for each name, or none where unknown."""
        for place, name in enumerate(names):
            if len(celsius) == len(names):
                self._read[name] = float(celsius[place]), now
            else:
                self._read.pop(name, None)

    def at(self, drive: str, now: float) -> float:
        """Return a drive's temperature, °C; NaN where it is missing or older than STALE_AFTER."""
        return math.nan if self.fault(drive, now) else self._read[drive][0]

    def fault(self, drive: str, now: float) -> Fault | None:
        """Return the fault of a drive's temperature (missing, NaN, stale); None if it is sound."""
        if drive not in self._read:
            return Fault(FaultKind.STALE, f'drive_supply has no winding temperature of {drive}')
        celsius, came = self._read[drive]
        if not math.isfinite(celsius):
            return Fault(FaultKind.NOT_FINITE, f'winding temperature of {drive}: {celsius} °C')
        if now - came > STALE_AFTER:
            return Fault(
                FaultKind.STALE,
                f'the winding temperature of {drive} is {now - came:.1f} s old, limit '
                f'{STALE_AFTER:g} s',
            )
        return None
