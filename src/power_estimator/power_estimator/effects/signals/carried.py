"""Memory of effects from one block of samples to the next."""

from collections.abc import Hashable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class Carried:
    """
    States of effects with memory at each of the last samples.

    Blocks may overlap: an effect begins with its state at the last sample before the block's.
    """

    def __init__(self) -> None:
        self._kept: dict[Hashable, tuple[Floats, Floats]] = {}
        self._unknown: dict[Hashable, float] = {}

    @property
    def used(self) -> bool:
        """Return whether an effect has kept a state."""
        return bool(self._kept)

    @property
    def unknown(self) -> float:
        """Largest share of a state that stems from before the first sample."""
        return max(self._unknown.values(), default=0.0)

    def before(self, effect: Hashable, time: float) -> tuple[float, Floats] | None:
        """Return the time (s) and the state of the last sample before a time, if there is one."""
        times, states = self._kept.get(effect, (np.empty(0), np.empty(0)))
        row = int(np.searchsorted(times, time)) - 1
        return None if row < 0 else (float(times[row]), states[row])

    def keep(self, effect: Hashable, times: Floats, states: Floats, unknown: float) -> None:
        """Keep the states [T, …] at these times in s [T], and their unknown share."""
        before = self.before(effect, float(times[0]))
        if before is not None:
            times = np.concatenate([[before[0]], times])
            states = np.concatenate([before[1][None], states])
        self._kept[effect] = (times, states)
        self._unknown[effect] = unknown
