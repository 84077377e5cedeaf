"""Winding temperatures as they came, and whether they may still be gone by."""

import math
from collections.abc import Sequence
from typing import Final

from policy_runner.supervisor.safety import Fault, FaultKind

STALE_AFTER: Final = 2.0  # s


class Windings:
    """The newest winding temperature of each drive, °C, with the time at which it came, s."""

    def __init__(self) -> None:
        self._read: dict[str, tuple[float, float]] = {}

    def on_supply(self, names: Sequence[str], celsius: Sequence[float], now: float) -> None:
        """Take what drive_supply says of its drives: one value each, or none where unknown."""
        for place, name in enumerate(names):
            if len(celsius) == len(names):
                self._read[name] = float(celsius[place]), now
            else:
                self._read.pop(name, None)

    def at(self, drive: str, now: float) -> float:
        """Temperature of a drive, °C; NaN where it is missing, NaN or older than STALE_AFTER."""
        return math.nan if self.fault(drive, now) else self._read[drive][0]

    def fault(self, drive: str, now: float) -> Fault | None:
        """Why the temperature of a drive may not be gone by, None if it may."""
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
