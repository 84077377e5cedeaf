"""Rate limiting of velocity commands."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from wattwalk_core.arrays import Floats

COMMAND_RATE_LIMIT: Final = (1.0, 1.0, 2.0)
"""Rate limit of the scripted trots: m/s², m/s², rad/s²."""


class CommandRateLimiter:
    """Rate-limited velocity commands of N robots.

    limits: m/s², m/s², rad/s²; empty for none. `values` holds the limited commands [N, 3].
    """

    def __init__(self, limits: Sequence[float], count: int = 1) -> None:
        self._limits = np.array(limits or (np.inf,) * 3)
        self._limited = bool(np.isfinite(self._limits).all())
        self.values = np.zeros((count, 3))  # m/s, m/s, rad/s

    def advance(self, seconds: float, commands: Floats) -> Floats:
        """Advance towards commands [N, 3] and return the limited commands [N, 3]."""
        if self._limited:
            most = self._limits * seconds
            away = commands - self.values
            self.values = self.values + np.minimum(np.maximum(away, -most), most)
        else:
            self.values = np.array(commands, np.float64)
        return self.values
