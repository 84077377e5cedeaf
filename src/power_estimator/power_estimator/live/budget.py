"""Energy budget of the last seconds of a live estimate."""

from collections import deque
from collections.abc import Mapping
from statistics import fmean
from typing import Final

import numpy as np
from wattwalk_core.recent_power import SECONDS, budget_figures

from power_estimator.effects.split import SHAFT
from power_estimator.live.estimator import Estimate, Status

REGENERATION: Final = 'regeneration'
_SECOND: Final = 1_000_000_000  # ns


class LiveBudget:
    """Mean power of all drives by part, over the last ten seconds of estimates.

    What a drive's shaft gave back is regeneration, negative. Estimates that cannot be relied on
    are left out; it begins anew where they stop or go back in time.
    """

    def __init__(self) -> None:
        self._rows: deque[tuple[int, Mapping[str, float]]] = deque()  # stamps, W by part

    def take(self, estimate: Estimate) -> None:
        """Take the next estimate; those whose status is not OK do not count."""
        if estimate.status is Status.INPUT_STALE:
            self._rows.clear()
        if estimate.status is not Status.OK or not estimate.parts:
            return
        watts = {part: float(np.nansum(power)) for part, power in estimate.parts.items()}
        if SHAFT in watts:
            back = float(np.minimum(np.nan_to_num(estimate.parts[SHAFT]), 0.0).sum())
            watts[SHAFT] -= back
            watts[REGENERATION] = back
        if self._rows:
            last, before = self._rows[-1]
            if estimate.stamp < last or watts.keys() != before.keys():
                self._rows.clear()
        self._rows.append((estimate.stamp, watts))
        while estimate.stamp - self._rows[0][0] >= SECONDS * _SECOND:
            self._rows.popleft()

    @property
    def seconds(self) -> float:
        """Time from the first to the last estimate in the mean, s."""
        return (self._rows[-1][0] - self._rows[0][0]) / _SECOND if self._rows else 0.0

    @property
    def parts(self) -> Mapping[str, float]:
        """Mean power by part, W, the largest first; empty before the first estimate."""
        if not self._rows:
            return {}
        means = {part: fmean(own[part] for _, own in self._rows) for part in self._rows[0][1]}
        return dict(sorted(means.items(), key=lambda item: -item[1]))

    def report(self) -> tuple[str, dict[str, str]]:
        """Return a sentence, and the mean power by part as figures, `PART [W]`."""
        parts = self.parts
        if not parts:
            return 'no estimates yet', {}
        total = sum(parts.values())
        largest = [f'{name.replace("_", " ")} {watts:.1f} W' for name, watts in parts.items()]
        sentence = f'{total:.1f} W in the last {self.seconds:.0f} s: {", ".join(largest[:3])}'
        return sentence, budget_figures(parts)
