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

    parts: dict[str, Floats] = {}
    by_column: dict[tuple[str, int], Floats] = {}

    def note_slopes(part: str, active: Active, columns: Floats) -> None:
        for term, column in enumerate(structure.columns_of(active.name)):
            by_column[part, column] = columns[..., term]

    def put(active: Active, own: Floats, columns: Floats) -> None:
        """An effect's power from columns [T, D, n] in W per unit."""
        parts[active.name] = weighted(columns, own)
        if slopes:
            note_slopes(active.name, active, columns)

    done = estimates(structure, coefficients, signals, base, keep)
    for active in structure.actives:
        if active.effect.fixed is not None:
            parts[active.name] = active.effect.fixed * kept[active.name][..., 0]
    pairs = by_effect(structure, coefficients)
    slope_of = {
        active.name: slope
        for active, own in pairs
        if (by_torque := active.effect.torque_slope) is not None and own.any()
        if (slope := by_torque(done, own[None])) is not None
    }
    if base is not None:
        added = np.square(done.motor_torque) - np.square(done.torque)
        parts[BASE] = base.power + base.copper * added
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
                put(active, own, columns * done.motor_velocity[..., None])
                for name, slope in slope_of.items() if slopes else ():
                    # What its torque adds to the losses of others.
                    note_slopes(name, active, slope[..., None] * columns)
        before = replace(done, motor_torque=done.torque + torque)
    for active, own in pairs:
        if active.effect.acts_on == 'speed':
            put(active, own, columns_of(active, signals) * signals.torque[..., None])
        elif active.effect.acts_on == 'power':
            put(active, own, columns_of(active, done))
    return Split(parts, by_column)


Reduce = Callable[[Floats], Floats]


def reduced(found: Split, reduce: Reduce) -> Split:
    """Return the split at the reduced rate; reduce: [T, D] → [N, D]."""
    return Split(
        {name: reduce(values) for name, values in found.parts.items()},
        {key: reduce(values) for key, values in found.slopes.items()},
    )
