"""
Rough ground for N robots without a height field: one plane under each foot.

Where a foot touches, a height field is one of its triangles. The plane of that triangle is put
under the foot before each time step, so that contact is that of a sphere on a plane, which
takes two thirds of the time. Thighs, shanks and base touch a level plane as high as the lowest.
"""

from typing import Final

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter
from sim_bridge.plant.terrain import Terrain
from wattwalk_core.anymal import FOOT_NAMES

Floats = NDArray[np.float64]

_RIM: Final = 8.0  # m of the ground's edge where nobody starts
_NEAR: Final = 0.8  # m, edge of the patch whose highest point a robot is put above


def add_planes(spec: mujoco.MjSpec, friction: float) -> None:
    """Add a plane for each foot that collides with it alone, in place of the floor."""
    for index, foot in enumerate(FOOT_NAMES):
        own = 2 << index
        spec.geom(foot).conaffinity = own
        spec.worldbody.add_geom(
            name=f'{foot}_ground',
            type=mujoco.mjtGeom.mjGEOM_PLANE,
            pos=[0, 0, -1.0],
            quat=[0.8, 0.6, 0, 0],
            size=[0, 0, 1],
            contype=own,
            conaffinity=0,
            friction=[friction, 0.005, 0.0001],
        )


class Ground:
    """Planes of all robots of a batch, moved under the feet by `follow`."""

    def __init__(self, terrain: Terrain, model: mujoco.MjModel, batch: Batch) -> None:
        self.relief = Relief(terrain)
        self._planes = [model.geom(f'{foot}_ground').id for foot in FOOT_NAMES]
        self._floor = model.geom('floor').id
        self._position = batch.expand('geom_pos')
        self._attitude = batch.expand('geom_quat')

    def follow(self, soles: Floats) -> None:
        """Move the planes to feet, m [N, 4, 3] in the world."""
        height, slope = self.relief.at(soles[..., :2])
        self._position[:, self._planes, :2] = soles[..., :2]
        self._position[:, self._planes, 2] = height
        self._position[:, self._floor, 2] = height.min(axis=1)
        # The rotation that takes z to (−∂h/∂x, −∂h/∂y, 1), by half angles.
        long = np.sqrt(1.0 + np.square(slope).sum(axis=-1))
        half = np.sqrt(0.5 * (1.0 + 1.0 / long))
        scale = 0.5 / (half * long)
        self._attitude[:, self._planes, 0] = half
        self._attitude[:, self._planes, 1] = slope[..., 1] * scale
        self._attitude[:, self._planes, 2] = -slope[..., 0] * scale
        self._attitude[:, self._planes, 3] = 0.0


class Relief:
    """Heights and slopes of a terrain at any place."""

    def __init__(self, terrain: Terrain) -> None:
        self._heights = np.zeros((3, 3)) if terrain.is_flat else terrain.heights()
        self._half = terrain.extent / 2
        self._cells = len(self._heights) - 1
        self._cell = terrain.extent / self._cells
        span = round(_NEAR / self._cell) | 1
        self._highest = maximum_filter(self._heights, size=span)
        self.reach = self._half - _RIM

    def at(self, where: Floats) -> tuple[Floats, Floats]:
        """
        Return height, m [...], and slope along x and y [..., 2] at places x, y in m [..., 2].

        Each cell is two triangles that meet between its corners at low x, low y and at high x,
        high y, as in MuJoCo's height fields.
        """
        place = np.clip((where + self._half) / self._cell, 0.0, self._cells - 1e-9)
        index = place.astype(np.intp)
        column, row = index[..., 0], index[..., 1]
        u, v = np.moveaxis(place - index, -1, 0)
        low, high = self._heights[row, column], self._heights[row + 1, column + 1]
        upper = v > u
        corner = np.where(upper, self._heights[row + 1, column], self._heights[row, column + 1])
        along_x = np.where(upper, high - corner, corner - low)
        along_y = np.where(upper, corner - low, high - corner)
        height: Floats = low + along_x * u + along_y * v
        return height, np.stack([along_x, along_y], axis=-1) / self._cell

    def above(self, where: Floats) -> Floats:
        """Return the highest ground near places x, y in m [N, 2], m [N]."""
        index = np.rint((where + self._half) / self._cell).astype(np.intp)
        column, row = np.clip(index, 0, self._cells).T
        height: Floats = self._highest[row, column]
        return height
