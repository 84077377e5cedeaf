"""Efficiency of a type of drives over torque and speed."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from wattwalk_core.arrays import Floats

from power_lab.budget.budget import Budget, Steady

_GRID: Final = 60
_STATES: Final = 1500  # visited states that are kept
_RARE: Final = 0.002  # of the rows, beyond the edges


@dataclass(frozen=True)
class EfficiencyMap:
    """Efficiency in steady motion, and the states that a recording visits.

    Torque is along the motion: above 0 the drive drives, below it brakes.
    """

    name: str  # of the type of drives
    speed: Floats  # rad/s [S]
    torque: Floats  # N·m [Q]
    percent: Floats  # [Q, S], of the supply's power driving, of the shaft's braking
    states: Floats  # visited speeds and torques [V, 2]

    @classmethod
    def of(cls, name: str, steady: Steady, state: Mapping[str, Floats]) -> 'EfficiencyMap':
        """Evaluate a drive's model over its visited range; state: `torque`, `velocity` [N, D]."""
        torque, velocity = (state[key][:, steady.drive] for key in ('torque', 'velocity'))
        speed, along = np.abs(velocity), torque * np.sign(velocity)
        ends = np.quantile(along, [_RARE, 1.0 - _RARE])
        x = np.linspace(0.0, float(np.quantile(speed, 1.0 - _RARE)), _GRID + 1)[1:]
        y = np.linspace(float(ends[0]), float(ends[1]), _GRID)
        power = steady.power(*(values.ravel() for values in np.meshgrid(x, y)))
        shaft = (x[None] * y[:, None]).ravel()
        with np.errstate(divide='ignore', invalid='ignore'):
            ratio = np.where(shaft >= 0.0, shaft / power, power / shaft)
        percent = 100.0 * np.nan_to_num(np.clip(ratio, 0.0, 1.0)).reshape(_GRID, _GRID)
        every = slice(None, None, max(1, len(along) // _STATES))
        return cls(name, x, y, percent, np.stack([speed[every], along[every]], axis=1))

    def json(self) -> dict[str, Any]:
        """Return JSON-compatible values, rounded to 0.001."""
        values = self.speed, self.torque, self.percent, self.states
        names = 'speed', 'torque', 'percent', 'states'
        rounded = {n: np.round(own, 3).tolist() for n, own in zip(names, values, strict=True)}
        return {'name': self.name, **rounded}


def efficiency_maps(budget: Budget) -> list[EfficiencyMap]:
    """Return an efficiency map for each drive type of a budget; none for a model with a base."""
    state = budget.pictured.state
    return [EfficiencyMap.of(name, steady, state) for name, steady in budget.steady.items()]
