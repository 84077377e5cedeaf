"""Estimates of the live node in a recording, as a power model."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from power_recordings.alignment.dataset import AlignedDataset
from power_recordings.messages.samples import EstimateSamples
from power_recordings.reading.reader import Recording
from wattwalk_core.errors import InputError

from power_estimator.model import Needs

Floats = NDArray[np.float32]
RECORDED: Final = 'recorded'
AS_RECORDED: Final = 'as it was recorded'
_STANDS_FOR: Final = 0.02  # s that end at an estimate's stamp
_LONGEST_GAP: Final = 0.05  # s between estimates that are joined by a line


class RecordedEstimate:
    """
    The `power_estimate` topic of recordings.

    An estimate is the mean of the 20 ms that end at its stamp. It is placed in their middle and
    interpolated linearly. Estimates whose status is not 0 count as unknown.
    """

    name = RECORDED
    needs = Needs({}, 1 / _STANDS_FOR, smooth=False)

    def __init__(self, bags: Sequence[Path]) -> None:
        """Read the estimates; InputError for a recording that has none."""
        self._estimates: list[EstimateSamples] = []
        for bag in bags:
            recording = Recording.open(bag)
            if not recording.has('power_estimate'):
                raise InputError(
                    f'{bag} has no power_estimate topic: leave the model {RECORDED!r} out, or '
                    f'record while `ros2 run power_estimator estimate` runs'
                )
            self._estimates.append(recording.power_estimate())

    def predict(self, data: AlignedDataset) -> Floats:
        """Return the estimates in W [T, D]; data must be of the same recordings in order."""
        power = np.full(data.power.shape, np.nan, np.float32)
        for number, estimates in enumerate(self._estimates):
            rows = np.flatnonzero(data.recording == number)
            good = estimates.status == 0
            times = estimates.stamp_ns[good] / 1e9 - _STANDS_FOR / 2
            if len(times) < 2:
                continue
            after = np.clip(np.searchsorted(times, data.time[rows]), 1, len(times) - 1)
            before = after - 1
            inside = (times[before] <= data.time[rows]) & (data.time[rows] <= times[after])
            inside &= times[after] - times[before] < _LONGEST_GAP
            for column, name in enumerate(data.names):
                if name in estimates.names:
                    known = estimates.power[good, estimates.names.index(name)]
                    line = np.interp(data.time[rows], times, known)
                    power[rows, column] = np.where(inside, line, np.nan)
        return power
