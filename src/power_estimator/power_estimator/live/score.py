"""Figures of the live estimate: its budget, and how it compares with the measured power."""

from collections import deque
from collections.abc import Mapping
from statistics import fmean
from typing import Final

import numpy as np
from numpy.typing import ArrayLike
from wattwalk_core.arrays import Floats
from wattwalk_core.recent_power import SECONDS, budget_figures

from power_estimator.effects.split import SHAFT
from power_estimator.live.estimator import Estimate, Status
from power_estimator.scores import r2

REGENERATION: Final = 'regeneration'
_SECOND: Final = 1_000_000_000  # ns
_WINDOW: Final = 30.0  # s over which R² is taken


class LiveScore:
    """Scores of estimates against the mean of the measured power over the same time.

    An estimate waits until measurements reach its stamp, so that late samples count as well.
    """

    def __init__(self, width: float) -> None:
        """width: s that an estimate covers."""
        self._width = round(width * 1e9)
        self._second = max(1, round(1 / width))
        self._waiting: deque[tuple[int, float]] = deque(maxlen=100)
        self._measured: deque[tuple[int, float]] = deque(maxlen=2000)
        self._pairs: deque[tuple[float, float]] = deque(maxlen=max(1, round(_WINDOW / width)))

    def measured(self, stamp: int, watts: float) -> None:
        """Take the measured sum of the drives, W, at a stamp (ns)."""
        while self._waiting and self._waiting[0][0] < stamp:
            end, estimated = self._waiting.popleft()
            while self._measured and self._measured[0][0] <= end - self._width:
                self._measured.popleft()
            inside = [w for when, w in self._measured if when <= end]
            if inside:
                self._pairs.append((float(np.mean(inside)), estimated))
        self._measured.append((stamp, watts))

    def estimated(self, stamp: int, watts: float) -> None:
        """Take the estimated sum, W, over the width before a stamp (ns)."""
        if np.isfinite(watts):
            self._waiting.append((stamp, watts))

    def figures(self) -> dict[str, str]:
        """Return means of the last second and R² as text by name; empty before a second."""
        if len(self._pairs) < self._second:
            return {}
        measured, estimated = np.array(self._pairs).T
        return {
            'measured': f'{measured[-self._second :].mean():.1f} W over 1 s',
            'estimated': f'{estimated[-self._second :].mean():.1f} W over 1 s',
            'R² of the sum': f'{r2(measured, estimated):.3f} over {_WINDOW:.0f} s',
        }


def measured_power(
    drives: int, voltage: ArrayLike, current: ArrayLike, status: ArrayLike
) -> Floats:
    """Return the power in W [samples, drives] of a DriveSupply message, NaN for a status over 0.

    voltage, current, status: row-major [samples × drives]. ValueError for other lengths.
    """
    volts, amperes, flags = (np.asarray(x, float) for x in (voltage, current, status))
    if not volts.size == amperes.size == flags.size or not drives or volts.size % drives:
        raise ValueError(
            f'{volts.size} voltages, {amperes.size} currents and {flags.size} status values do '
            f'not fit {drives} drives'
        )
    return np.where(flags == 0, volts * amperes, np.nan).reshape(-1, drives)


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
