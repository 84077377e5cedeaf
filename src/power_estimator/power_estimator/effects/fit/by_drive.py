"""Designs made drive by drive: less memory at a time, and several drives at once."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from wattwalk_core.arrays import Floats

from power_estimator.effects.fit.blocks import for_each
from power_estimator.effects.fit.design import Active, Design, Structure
from power_estimator.effects.fit.design_builder import DesignBuilder, Linearisation

Result = TypeVar('Result')
_ESTIMATES = (
    'motor_velocity',
    'motor_acceleration',
    'motor_torque',
    'torque_cost',
    'electronics',
    'drawn',
)


class ByDriveBuilder(DesignBuilder):
    """Builder of designs of several metered drives, drive by drive where effects allow it.

    Effects that look at other drives are computed from the signals of all.
    """

    @cached_property
    def _drives(self) -> list[DesignBuilder]:
        """Builders of one drive each, with copies of its signals."""
        base, count = self.base, len(self.prepared.names)
        return [
            DesignBuilder(
                self.prepared.drive(index),
                None if base is None else base.drive(index),
                self.kept // count,
            )
            for index in range(count)
        ]

    def _point(self, structure: Structure, coefficients: Floats) -> Linearisation:
        if not _apart(structure.actives):
            return super()._point(structure, coefficients)
        points = self._each(lambda builder, own: builder.point(structure, own), coefficients)
        joined: dict[str, Any] = {
            name: np.concatenate([getattr(point.signals, name) for point in points], axis=1)
            for name in _ESTIMATES
        }
        own = self.prepared.signals
        if all(point.signals.motor_velocity is point.signals.velocity for point in points):
            joined |= {'motor_velocity': own.velocity, 'motor_acceleration': own.acceleration}
        power = np.concatenate([point.power for point in points], axis=1)
        passed: Floats | None = None
        if any(point.passed is not None for point in points):
            ones = np.ones((len(power), 1))
            passed = np.concatenate(
                [ones if point.passed is None else point.passed for point in points], axis=1
            )
        signals = replace(own, **joined)
        return Linearisation(structure, coefficients, signals, power, passed)

    def build(self, structure: Structure, coefficients: Floats, *, keep: bool = False) -> Design:
        """Linearise about coefficients [D, m]; keep: hold the columns for other designs there."""
        if not _apart(structure.actives):
            return super().build(structure, coefficients, keep=keep)
        parts = self._each(
            lambda builder, own: builder.build(structure, own, keep=keep), coefficients
        )
        return Design(
            structure,
            np.concatenate([part.columns for part in parts], axis=1),
            np.concatenate([part.constant for part in parts], axis=1),
            *structure.bounds(coefficients, self.prepared.scale),
        )

    def beside(
        self, actives: Sequence[Active], structure: Structure, coefficients: Floats
    ) -> list[Floats]:
        """Return reduced columns [N, D, n] of effects beside a structure at coefficients."""
        if not _apart(structure.actives):
            return super().beside(actives, structure, coefficients)
        apart = [active for active in actives if active.per_drive]
        parts = self._each(
            lambda builder, own: builder.beside(apart, structure, own), coefficients
        )
        known = {
            active.key: np.concatenate(columns, axis=1)
            for active, *columns in zip(apart, *parts, strict=True)
        }
        rest = [active for active in actives if not active.per_drive]
        beside = super().beside(rest, structure, coefficients) if rest else []
        known |= {active.key: columns for active, columns in zip(rest, beside, strict=True)}
        return [known[active.key] for active in actives]

    def _each(
        self, made: Callable[[DesignBuilder, Floats], Result], coefficients: Floats
    ) -> list[Result]:
        def one(index: int) -> Result:
            return made(self._drives[index], coefficients[index : index + 1])

        return for_each(one, range(len(self._drives)))


def _apart(actives: Sequence[Active]) -> bool:
    """Return whether no effect looks at other drives than its own."""
    return all(active.per_drive for active in actives)
