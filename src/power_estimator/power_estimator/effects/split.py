"""Power of a model by effect: parts that sum to the model's power, and their slopes."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from wattwalk_core.arrays import Floats

from power_estimator.effects import Signals
from power_estimator.effects.fit.design import (
    Active,
    BasePower,
    Structure,
    by_effect,
    estimates,
    weighted,
)

SHAFT, BASE = 'shaft', 'base'


@dataclass(frozen=True)
class Split:
    """Power of each effect, W [T, D], and its derivatives by the coefficients of the structure.

    Friction counts with the power that it takes at the shaft; the copper loss of the torque that
    carries it counts as copper loss, where it becomes heat.
    """

    parts: Mapping[str, Floats]
    slopes: Mapping[tuple[str, int], Floats]  # by part and column, W per unit [T, D]

    def drive(self, place: int) -> 'Split':
        """Return the split of one drive, by its column: parts and slopes are [T]."""
        return Split(
            {name: values[:, place] for name, values in self.parts.items()},
            {key: values[:, place] for key, values in self.slopes.items()},
        )


def split(
    structure: Structure,
    coefficients: Floats,
    signals: Signals,
    base: BasePower | None = None,
    *,
    slopes: bool = True,
) -> Split:
    """Split the power of a model with coefficients [D, m] by effect; base: power underneath.

    Regressors that its power is made of are computed once; without slopes it costs what `evaluate`
    does.
    """
    kept: dict[str, Floats] = {}

    def keep(active: Active, seen: Signals) -> Floats:
        kept[active.name] = active.columns(seen)
        return kept[active.name]

    def columns_of(active: Active, seen: Signals) -> Floats:
        return kept[active.name] if active.name in kept else active.columns(seen)

    done = estimates(structure, coefficients, signals, base, keep)
    found = _Collected(structure, slopes)
    for active in structure.actives:
        if active.effect.fixed is not None:
            found.parts[active.name] = active.effect.fixed * kept[active.name][..., 0]
    pairs = by_effect(structure, coefficients)
    slope_of = {
        active.name: slope
        for active, own in pairs
        if (by_torque := active.effect.torque_slope) is not None and own.any()
        if (slope := by_torque(done, own[None])) is not None
    }
    if base is not None:
        added = np.square(done.motor_torque) - np.square(done.torque)
        found.parts[BASE] = base.power + base.copper * added
        slope_of[BASE] = 2.0 * base.copper * done.motor_torque
    before = done
    for follows in (False, True):
        torque = np.zeros_like(done.torque)
        for active, own in pairs:
            if active.effect.acts_on != 'torque':
                continue
            if ('motor_torque' in active.effect.follows) is follows:
                columns = columns_of(active, before)
                torque += weighted(columns, own)
                found.put(active, own, columns * done.motor_velocity[..., None])
                found.add_slopes(active, columns, slope_of)
        before = replace(done, motor_torque=done.torque + torque)
    for active, own in pairs:
        if active.effect.acts_on == 'speed':
            found.put(active, own, columns_of(active, signals) * signals.torque[..., None])
        elif active.effect.acts_on == 'power':
            found.put(active, own, columns_of(active, done))
    return Split(found.parts, found.slopes)


class _Collected:
    def __init__(self, structure: Structure, slopes: bool) -> None:
        self._structure, self._wanted = structure, slopes
        self.parts: dict[str, Floats] = {}
        self.slopes: dict[tuple[str, int], Floats] = {}

    def put(self, active: Active, own: Floats, columns: Floats) -> None:
        """An effect's power from columns [T, D, n] in W per unit."""
        self.parts[active.name] = weighted(columns, own)
        if self._wanted:
            for term, column in enumerate(self._structure.columns_of(active.name)):
                self.slopes[active.name, column] = columns[..., term]

    def add_slopes(self, active: Active, columns: Floats, slope_of: Mapping[str, Floats]) -> None:
        """Slopes of what torque of one effect adds to the losses of others."""
        if self._wanted:
            for name, slope in slope_of.items():
                for term, column in enumerate(self._structure.columns_of(active.name)):
                    self.slopes[name, column] = slope * columns[..., term]


Reduce = Callable[[Floats], Floats]


def reduced(found: Split, reduce: Reduce) -> Split:
    """Return the split at the reduced rate; reduce: [T, D] → [N, D]."""
    return Split(
        {name: reduce(values) for name, values in found.parts.items()},
        {key: reduce(values) for key, values in found.slopes.items()},
    )
