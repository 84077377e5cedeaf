"""Power of a leg over its gait cycle."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import numpy as np
from power_estimator.effects.signals.reducer import REDUCED_RATE
from wattwalk_core.arrays import Bools, Floats

from power_lab.budget.accounts import PartsOverTime
from power_lab.budget.families import family_of

_BINS: Final = 24  # at most; strides of half a second have 25 rows
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
        """Average over strides; None without foot contacts, drive meters or five strides a leg."""
        if 'stance' not in rows.masks or rows.metered.shape[1] != len(rows.names):
            return None
        legs = {name.split('_')[0] for name in rows.names}
        feet = [_strides(own, rows.stretches) for own in rows.masks['stance'].T]
        if min(len(lengths) for _, lengths in feet) < _LEAST_CYCLES:
            return None
        # A stride fills as many bins as it has rows.
        bins = min(_BINS, *(int(np.median(lengths)) for _, lengths in feet))
        sums: dict[str, Floats] = {}
        metered, duty = np.zeros(bins), []
        for drive, (phase, _) in enumerate(feet):
            powers = np.column_stack([rows.metered[:, drive], rows.power[:, drive]])
            known = np.isfinite(phase) & np.isfinite(powers).all(axis=1)
            place = np.minimum((phase[known] * bins).astype(int), bins - 1)
            count = np.bincount(place, minlength=bins)
            if not count.all():
                return None
            mean, *parts = (np.bincount(place, own, bins) / count for own in powers[known].T)
            metered += mean / len(legs)
            for family, own in zip(
                (*map(family_of, rows.parts), 'unexplained'),
                (*parts, mean - np.sum(parts, axis=0)),
                strict=True,
            ):
                sums[family] = sums.get(family, np.zeros(bins)) + own / len(legs)
            duty.append(float(np.mean(rows.masks['stance'][known, drive])))
        percent = (np.arange(bins) + 0.5) * 100.0 / bins
        return cls(percent, sums, metered, 100.0 * float(np.mean(duty)))

    def json(self) -> dict[str, Any]:
        """Return JSON-compatible values, power rounded to 1 mW."""
        return {
            'percent': self.percent.tolist(),
            'families': {name: np.round(own, 3).tolist() for name, own in self.families.items()},
            'metered': np.round(self.metered, 3).tolist(),
            'stance': self.stance,
        }


def _strides(stands: Bools, stretches: Sequence[slice]) -> tuple[Floats, list[int]]:
    """Phase from touch-down to touch-down, 0 to 1 [N], and rows of each stride.

    The phase is NaN outside whole strides.
    """
    phase, lengths = np.full(len(stands), np.nan), []
    for part in stretches:
        landings = part.start + 1 + np.flatnonzero(stands[part][1:] & ~stands[part][:-1])
        for start, stop in pairwise(landings.tolist()):
            if _CYCLES[0] <= (stop - start) / REDUCED_RATE <= _CYCLES[1]:
                phase[start:stop] = np.arange(stop - start) / (stop - start)
                lengths.append(stop - start)
    return phase, lengths
