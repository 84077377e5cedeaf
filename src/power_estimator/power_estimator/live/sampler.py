"""Causal resampling of joint states at any rate to that of a power model."""

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

Doubles = NDArray[np.float64]
_AHEAD: Final = 1.25e6  # ns, half the time between joint states at 400 Hz
_BRIDGED: Final = 0.01  # s of missing joint states before the past is dropped


class CausalSampler:
    """
    Means of the joint states in bins of 1/rate, cut by the stamps.

    A sample is returned with the last joint state in its bin, not with the first of the next bin.
    At 400 Hz in and 200 Hz out that is the mean of two: a delay of 1.25 ms and −3 dB at 100 Hz.
    Up to 10 ms of empty bins are interpolated; after a longer gap, or a step back in time, the
    sample is fresh.
    """

    def __init__(self, rate: float) -> None:
        self._width = 1e9 / rate
        self._bridged = round(_BRIDGED * rate)
        self._origin: float | None = None
        self._bin = self._last_bin = 0
        self._period = 0.0
        self._stamp = 0
        self._sum: Doubles = np.zeros(0)
        self._count = 0
        self._previous: tuple[int, Doubles] | None = None

    def add(self, stamp: int, signals: Doubles) -> Iterator[tuple[int, Doubles, bool]]:
        """Take one joint state, signals [S, D]; yield (stamp, mean [S, D], fresh) of full bins."""
        if self._origin is None:
            self._origin = stamp - _AHEAD
        else:
            step = stamp - self._stamp
            if -1e9 < step <= 0:
                return
            if step > 0:
                known = self._period or step
                self._period = known + 0.05 * max(-known / 2, min(step - known, known / 2))
        index = int((stamp - self._origin) // self._width)
        if index != self._bin and self._count:
            yield from self._close()
        self._bin, self._stamp = index, stamp
        self._sum = self._sum + signals if self._count else signals
        self._count += 1
        if self._period and (stamp + self._period - self._origin) // self._width != index:
            yield from self._close()

    def _close(self) -> Iterator[tuple[int, Doubles, bool]]:
        mean, missing = self._sum / self._count, self._bin - self._last_bin - 1
        self._count = 0
        if self._previous is not None and missing == -1:
            return
        fresh = self._previous is None or not 0 <= missing <= self._bridged
        if self._previous is not None and not fresh:
            stamp, before = self._previous
            for share in np.arange(1, missing + 1) / (missing + 1):
                between = before + share * (mean - before)
                yield round(stamp + share * (self._stamp - stamp)), between, False
        self._last_bin, self._previous = self._bin, (self._stamp, mean)
        yield self._stamp, mean, fresh
