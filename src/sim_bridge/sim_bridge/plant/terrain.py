"""Terrain: level, or uneven as in Section II-A of the paper."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from wattwalk_core.arrays import Floats
from wattwalk_core.schema import CheckedFields, Quantity

TERRAINS = ('flat', 'rough')
_LEVEL_RADIUS = 1.0  # m around the start without noise
_RIM = 4.0  # m over which the heights run out to the plane around the field
_WAVES = 4


@dataclass(frozen=True)
class Terrain(CheckedFields):
    """Square patch of terrain centred on the start, with a plane around it.

    noise: uniform height noise of each cell's corners, ± (the paper: 0.02). slope: steepest
    incline of the undulation below the noise (the paper: 0.02). cell, extent: edges of a cell and
    of the patch. seed: of noise and undulation. InputError for values out of range.
    """

    noise: Annotated[float, Quantity(0.0, 0.2, 'm')] = 0.0
    slope: Annotated[float, Quantity(0.0, 0.2)] = 0.0
    cell: Annotated[float, Quantity(0.05, 1.0, 'm')] = 0.2
    extent: Annotated[float, Quantity(12.0, 200.0, 'm')] = 60.0
    seed: int = 0

    @property
    def is_flat(self) -> bool:
        """True for a plane."""
        return self.noise == 0.0 and self.slope == 0.0

    def heights(self) -> Floats:
        """Return the heights of the cells' corners, m [n, n], rows along y, columns along x.

        The undulation is a sum of plane waves whose gradients together stay below `slope`.
        """
        count = round(self.extent / self.cell) + 1
        random = np.random.default_rng(self.seed)
        axis = np.linspace(-self.extent / 2, self.extent / 2, count)
        x, y = np.meshgrid(axis, axis)
        heights = np.zeros((count, count))
        for _ in range(_WAVES):
            number = 2 * np.pi / random.uniform(8.0, 16.0)
            heading, phase = random.uniform(0.0, 2 * np.pi, 2)
            along = number * (np.cos(heading) * x + np.sin(heading) * y)
            heights += self.slope / _WAVES / number * (np.sin(along + phase) - np.sin(phase))
        rough = np.clip((np.hypot(x, y) - _LEVEL_RADIUS) / _LEVEL_RADIUS, 0.0, 1.0)
        heights += rough * random.uniform(-self.noise, self.noise, heights.shape)
        inside = self.extent / 2 - np.maximum(np.abs(x), np.abs(y))
        low = heights.min()
        return low + np.clip(inside / _RIM, 0.0, 1.0) * (heights - low)


FLAT = Terrain()


def rough(seed: int = 0) -> Terrain:
    """Return the terrain of the paper's Section II-A: noise of ±2 cm, slopes up to 2 %."""
    return Terrain(noise=0.02, slope=0.02, seed=seed)
