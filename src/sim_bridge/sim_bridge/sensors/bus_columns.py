"""Columns of a world's joints among the drives of a bus."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from power_daq.bus.description import BusDescription
from wattwalk_core.errors import InputError

Floats = NDArray[np.float64]


class BusColumns:
    """Places of D joints among the B drives of a bus; InputError for one that it lacks."""

    def __init__(self, bus: BusDescription, joints: Sequence[str]) -> None:
        for joint in joints:
            if joint not in bus.drives:
                raise InputError(f'joint {joint!r} is not on the bus; {", ".join(bus.drives)} are')
        self._count = len(bus.drives)
        self.places = [bus.drives.index(joint) for joint in joints]

    def spread(self, values: NDArray[np.generic]) -> Floats:
        """Return values of the joints [N, D] as those of all drives [N, B], 0 for the others."""
        wide = np.zeros((len(values), self._count))
        wide[:, self.places] = values
        return wide
