"""Comparison of the live estimate with the measured power."""

from collections import deque

import numpy as np
from numpy.typing import ArrayLike
from wattwalk_core.arrays import Floats

from power_estimator.scores import r2

_WINDOW = 30.0  # s over which R² is taken


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
