"""Split-conformal intervals of estimates, by predicted power."""

import math
from typing import Annotated

import numpy as np
from wattwalk_core.arrays import Floats, Singles
from wattwalk_core.errors import InputError
from wattwalk_core.schema import Quantity, check_quantities, schema

LEVEL = 0.9
_BINS = 8
_IN_A_BIN = 100  # residuals that a quantile of 5 % may rest on
_Watts = Annotated[float, Quantity(-1e9, 1e9, 'W')]


@schema
class Intervals:
    """Range in which the measured power of an estimate at 50 Hz lies with probability `level`.

    Bins of estimated power have their own widths, from residuals that the network was not
    trained on (split-conformal prediction; Lei et al. 2018, by bin as Boström et al. 2021). The
    level is nominal: residuals that follow each other closely, or that training was stopped by,
    are not exchangeable with new ones, so that no coverage is guaranteed.
    """

    level: Annotated[float, Quantity(0.01, 0.999)]
    edges: tuple[_Watts, ...]  # between the n bins [n − 1]
    below: tuple[_Watts, ...]  # by which the measured power may lie below the estimate [n]
    above: tuple[_Watts, ...]  # by which it may lie above [n]

    def __post_init__(self) -> None:
        check_quantities(self)
        numbers = (*self.edges, *self.below, *self.above)
        sizes = len(self.edges) + 1 == len(self.below) == len(self.above)
        if not sizes or not np.isfinite(numbers).all() or list(self.edges) != sorted(self.edges):
            raise InputError(f'intervals {numbers} are not finite numbers by ascending bins')

    @classmethod
    def fit(
        cls, measured: Singles, estimated: Singles, level: float = LEVEL
    ) -> 'Intervals | None':
        """Fit to pairs [N] at 50 Hz that the network was not trained on; None if there are few.

        Equal estimates stay in one bin, and no bin has fewer than 100 pairs.
        """
        both = np.isfinite(measured) & np.isfinite(estimated)
        y, f = measured[both].astype(float), estimated[both].astype(float)
        bins = min(_BINS, len(y) // _IN_A_BIN)
        if bins < 1:
            return None
        edges = _edges(f, bins)
        index = np.searchsorted(edges, f, side='right')
        below, above = [], []
        for number in range(len(edges) + 1):
            error = np.sort((y - f)[index == number])
            rank = max(1, math.floor((len(error) + 1) * (1 - level) / 2))
            below.append(-float(error[rank - 1]))
            above.append(float(error[-rank]))
        return cls(level, edges, tuple(below), tuple(above))

    def around(self, estimated: Singles) -> tuple[Singles, Singles]:
        """Return the lowest and highest power to be expected, W, in the shape of the estimates."""
        index = np.searchsorted(np.array(self.edges), estimated, side='right')
        low = estimated - np.array(self.below, np.float32)[index]
        return low, estimated + np.array(self.above, np.float32)[index]


def _edges(estimated: Floats, bins: int) -> tuple[float, ...]:
    """Return the edges of at most `bins` bins; fewer where ties would leave one too small."""
    ordered = np.sort(estimated)
    kept: list[float] = []
    begin = 0
    for edge in np.unique(np.quantile(ordered, np.arange(1, bins) / bins)).tolist():
        end = int(np.searchsorted(ordered, edge))
        if min(end - begin, len(ordered) - end) >= _IN_A_BIN:
            kept.append(edge)
            begin = end
    return tuple(kept)
