"""Power of a leg over its gait cycle."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from power_estimator.effects.signals.reducer import REDUCED_RATE
from wattwalk_core.arrays import Floats

from power_lab.budget.accounts import PartsOverTime
from power_lab.budget.families import family_of

_BINS: Final = 24  # strides of half a second have 25 rows
_CYCLES: Final = (0.2, 3.0)  # s, that a stride lasts
_LEAST_CYCLES: Final = 5


@dataclass(frozen=True)
class GaitCyclePower:
    """Power of one leg from touch-down to touch-down, mean over legs and strides."""

    percent: Floats  # of the cycle [B]
    families: Mapping[str, Floats]  # W [B]
    metered: Floats  # W [B]
    stance: float  # per cent of the cycle, that the foot is on the ground

    @classmethod
    def of(cls, rows: PartsOverTime) -> 'GaitCyclePower | None':
        """Average over strides; None where no feet were recorded or a leg takes too few."""
        if 'stance' not in rows.masks or rows.metered.shape[1] != len(rows.names):
            return None
        legs = {name.split('_')[0] for name in rows.names}
        sums: dict[str, Floats] = {}
        metered, duty = np.zeros(_BINS), []
        for drive in range(len(rows.names)):
            phase = _phases(rows.masks['stance'][:, drive], rows.stretches)
            known = np.isfinite(phase) & np.isfinite(rows.metered[:, drive])
            if phase[known].size < _LEAST_CYCLES * _BINS / 2:
                return None
            place = np.minimum((phase[known] * _BINS).astype(int), _BINS - 1)
            count = np.maximum(np.bincount(place, minlength=_BINS), 1) * len(legs)
            mean = np.bincount(place, rows.metered[known, drive], _BINS) / count
            metered += mean
            left = mean.copy()
            for part, values in zip(rows.parts, rows.power[known, drive].T, strict=True):
                own = np.bincount(place, values, _BINS) / count
                family = family_of(part)
                sums[family] = sums.get(family, np.zeros(_BINS)) + own
                left -= own
            sums['unexplained'] = sums.get('unexplained', np.zeros(_BINS)) + left
            duty.append(float(np.mean(rows.masks['stance'][known, drive])))
        percent = (np.arange(_BINS) + 0.5) * 100.0 / _BINS
        return cls(percent, sums, metered, 100.0 * float(np.mean(duty)))

    def json(self) -> dict[str, Any]:
        """Plain values."""
        return {
            'percent': self.percent.tolist(),
            'families': {name: np.round(own, 3).tolist() for name, own in self.families.items()},
            'metered': np.round(self.metered, 3).tolist(),
            'stance': self.stance,
        }


def _phases(stands: NDArray[np.bool_], stretches: Sequence[slice]) -> Floats:
    """Phase from touch-down to touch-down, 0 to 1 [N]; NaN outside whole strides."""
    phase = np.full(len(stands), np.nan)
    for part in stretches:
        landings = part.start + 1 + np.flatnonzero(stands[part][1:] & ~stands[part][:-1])
        for start, stop in pairwise(landings.tolist()):
            if _CYCLES[0] <= (stop - start) / REDUCED_RATE <= _CYCLES[1]:
                phase[start:stop] = np.arange(stop - start) / (stop - start)
    return phase
