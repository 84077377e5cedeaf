"""How far an estimate may be off: split-conformal intervals by predicted power."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from power_daq.cli import InputError

Floats = NDArray[np.float32]
LEVEL = 0.9
_BINS = 8
_IN_A_BIN = 100  # residuals that a quantile of 5 % may rest on


@dataclass(frozen=True)
class Intervals:
    """
    Where the measured power of an estimate at 50 Hz lies with probability `level`.

    Bins of estimated power have their own widths, from residuals that the network was not
    trained on (split-conformal prediction; Lei et al. 2018, by bin as Boström et al. 2021).
    """

    level: float
    edges: tuple[float, ...]  # W, between the n bins [n − 1]
    below: tuple[float, ...]  # W that the measured power may lie below the estimate [n]
    above: tuple[float, ...]  # W that it may lie above [n]

    def __post_init__(self) -> None:
        numbers = (*self.edges, *self.below, *self.above)
        if not 0 < self.level < 1:
            raise InputError(f'interval level = {self.level} is not within 0 … 1')
        sizes = len(self.edges) + 1 == len(self.below) == len(self.above)
        if not sizes or not np.isfinite(numbers).all() or list(self.edges) != sorted(self.edges):
            raise InputError(f'intervals {numbers} are not finite numbers by ascending bins')

    @classmethod
    def fit(cls, measured: Floats, estimated: Floats, level: float = LEVEL) -> 'Intervals | None':
        """From pairs [N] at 50 Hz that the network was not trained on; None if there are few."""
        both = np.isfinite(measured) & np.isfinite(estimated)
        y, f = measured[both].astype(float), estimated[both].astype(float)
        bins = min(_BINS, len(y) // _IN_A_BIN)
        if bins < 1:
            return None
        edges = np.quantile(f, np.arange(1, bins) / bins)
        index = np.searchsorted(edges, f, side='right')
        below, above = [], []
        for number in range(bins):
            error = np.sort((y - f)[index == number])
            rank = max(1, math.floor((len(error) + 1) * (1 - level) / 2))
            below.append(-float(error[rank - 1]))
            above.append(float(error[-rank]))
        return cls(level, tuple(edges.tolist()), tuple(below), tuple(above))

    def around(self, estimated: Floats) -> tuple[Floats, Floats]:
        """Lowest and highest power in W to be expected, of the shape of the estimates."""
        index = np.searchsorted(np.array(self.edges), estimated, side='right')
        low = estimated - np.array(self.below, np.float32)[index]
        return low, estimated + np.array(self.above, np.float32)[index]

    def content(self) -> dict[str, Any]:
        """As lists and numbers, for a card."""
        return {k: list(v) if isinstance(v, tuple) else v for k, v in asdict(self).items()}

    @classmethod
    def of(cls, content: Mapping[str, Any]) -> 'Intervals':
        """From `content`; KeyError, TypeError or InputError for anything else."""
        lists = (tuple(float(v) for v in content[k]) for k in ('edges', 'below', 'above'))
        return cls(float(content['level']), *lists)
