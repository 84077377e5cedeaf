"""Power of the last seconds: means of what is metered, and its parts with what is left over."""

from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from math import isfinite, nan
from typing import Final

import numpy as np
from numpy.typing import NDArray

SECONDS: Final = 10.0
"""s that a budget covers."""
REPORT: Final = ': budget'
"""End of the name under which an estimator reports its budget on `diagnostics`."""
UNEXPLAINED: Final = 'unexplained'
_UNIT: Final = ' [W]'
_SHOWN: Final = 0.05  # W, of a part at least
_SECOND: Final = 1_000_000_000  # ns


class RecentMean:
    """Mean of the samples of the last SECONDS; NaN before the first sample.

    Samples leave in the blocks in which they came. A block that goes back in time begins anew.
    """

    def __init__(self) -> None:
        self._blocks: deque[tuple[int, float, int]] = deque()  # last stamp, sum, count

    def add(self, stamp_ns: NDArray[np.int64], values: NDArray[np.floating]) -> None:
        """Add samples [N] with ascending stamps [N], ns; non-finite samples do not count."""
        known = np.isfinite(values)
        if not known.any():
            return
        last = int(stamp_ns[-1])
        if self._blocks and last < self._blocks[-1][0]:
            self._blocks.clear()
        self._blocks.append((last, float(values[known].sum(dtype=np.float64)), int(known.sum())))
        while last - self._blocks[0][0] >= SECONDS * _SECOND:
            self._blocks.popleft()

    @property
    def value(self) -> float:
        """Mean in the unit of the samples; NaN before the first."""
        count = sum(count for *_, count in self._blocks)
        return sum(total for _, total, _ in self._blocks) / count if count else nan


def budget_figures(parts: Mapping[str, float]) -> dict[str, str]:
    """Return power by part, W, as figures of a diagnostics report: {'PART [W]': '1.234'}."""
    return {f'{name}{_UNIT}': f'{watts:.3f}' for name, watts in parts.items()}


def parts_of(figures: Mapping[str, str]) -> dict[str, float]:
    """Return power by part, W, from figures of `budget_figures`; others are left out."""
    found = {}
    for name, value in figures.items():
        if name.endswith(_UNIT):
            with suppress(ValueError):
                found[name.removesuffix(_UNIT)] = float(value)
    return found


@dataclass(frozen=True)
class RecentBudget:
    """Mean power by part, W, the largest first, and the metered power that the parts add up to."""

    parts: Mapping[str, float]
    metered: float  # W of the supply, of the drives where no supply is metered

    @classmethod
    def of(cls, model: Mapping[str, float], drives: float, supply: float) -> 'RecentBudget':
        """Add to a model's parts what it leaves unexplained and what the electronics draw.

        model: W by part, empty without one; drives and supply: metered, W, NaN where not known.
        """
        metered = supply if isfinite(supply) else drives
        of_drives = drives if isfinite(drives) else supply
        rest = {
            UNEXPLAINED if model else 'drives': of_drives - sum(model.values()),
            'electronics': supply - drives,
        }
        parts = dict(model) | {name: watts for name, watts in rest.items() if isfinite(watts)}
        return cls(dict(sorted(parts.items(), key=lambda item: -item[1])), metered)

    def hours(self, battery: float) -> float:
        """Return the time in h that a battery of so many Wh lasts; NaN where it is not known."""
        return max(battery, 0.0) / self.metered if self.metered > 0.0 else nan

    def words(self, width: int) -> str:
        """Return the largest parts that fit `width` characters, W and share; unexplained last."""
        seen = {name: watts for name, watts in self.parts.items() if abs(watts) >= _SHOWN}
        last = [self._part(UNEXPLAINED)] if UNEXPLAINED in seen else []
        items = [self._part(name) for name in seen if name != UNEXPLAINED]
        while len(items) > 1 and len(', '.join([*items, *last])) > width:
            items.pop()
        return ', '.join([*items, *last])

    def _part(self, name: str) -> str:
        words = f'{name.replace("_", " ")} {self.parts[name]:.1f} W'
        if self.metered > 0.0:
            words += f' {100.0 * self.parts[name] / self.metered:.0f} %'
        return words
