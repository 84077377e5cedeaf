"""Fits to the power of a whole robot, of which no drive was metered by itself."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from power_estimator.effects import Effect, Shape, Signals
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.effects.fit.design_builder import DesignBuilder, Linearisation
from power_estimator.effects.signals.scale import DriveScale

Floats = NDArray[np.float64]
COMMON = frozenset({'idle', 'regeneration_limit', 'line_resistance'})
"""Effects of the robot's supply as a whole: drives cannot be told apart by them."""


class DriveShare(Effect):
    """An effect as some of the drives of a robot have it, seen in the robot's power."""

    def __init__(self, of: Effect, name: str, share: Floats) -> None:
        """Share [D, n]: by what each drive's regressors count; 0 for none."""
        self._of, self.share = of, share
        self.name = name  # type: ignore[misc]
        self.physics, self.formula = of.physics, of.formula  # type: ignore[misc]
        self.terms, self.acts_on, self.kind = of.terms, of.acts_on, of.kind  # type: ignore[misc]
        self.follows, self.shapes = of.follows, of.shapes  # type: ignore[misc]
        self.near, self.ties, self.excitation = of.near, of.ties, of.excitation  # type: ignore[misc]
        self.needs_joint_torque = of.needs_joint_torque  # type: ignore[misc]
        self.discrepancy_limit = of.discrepancy_limit  # type: ignore[misc]

    def regressors(self, signals: Signals, **shape: float) -> Floats:
        """Return the effect's regressors by the drives' shares."""
        return np.asarray(self._of.regressors(signals, **shape)) * self.share

    def torque_slope(self, signals: Signals, coefficients: Floats) -> Floats | None:
        """That of the effect at each drive's share."""
        return self._of.torque_slope(signals, coefficients * self.share)

    def drawn_slope(self, signals: Signals, coefficients: Floats, **shape: float) -> Floats | None:
        """That of the effect at each drive's share."""
        return self._of.drawn_slope(signals, coefficients * self.share, **shape)

    def discrepancy(self, signals: Signals, **shape: float) -> Floats | None:
        """Return the effect's discrepancy by the drives' shares of the first coefficient."""
        found = self._of.discrepancy(signals, **shape)
        return None if found is None else found * self.share[:, 0]

    def usable(self, signals: Signals, **shape: float) -> bool:
        """Return whether the effect is usable."""
        return self._of.usable(signals, **shape)

    def factors(self, scale: DriveScale) -> Floats:
        """1: the shares have the drives' sizes in them."""
        return np.ones((len(scale.torque), len(self.terms)))

    def shapes_of(self, scale: DriveScale) -> tuple[Shape, ...]:
        """Return the effect's shapes for one scale."""
        return self.shapes


def shared_by_size(effect: Effect, signals: Signals) -> Effect:
    """The effect with one coefficient for all drives, in proportion to their sizes."""
    if effect.kind != 'physics' or effect.fixed is not None or effect.name in COMMON:
        return effect
    return DriveShare(effect, effect.name, effect.factors(signals.scale))


def expanded(actives: Sequence[Active], signals: Signals) -> tuple[Active, ...]:
    """
    Effects as the robot's power may show them: each drive with a coefficient of its own.

    Effects with shapes have one coefficient in proportion to the drives' sizes, and effects of the
    supply one for all.
    """
    found: list[Active] = []
    for active in actives:
        effect = active.effect
        whole = shared_by_size(effect, signals)
        if whole is effect or len(effect.shapes) > 1:
            found.append(replace(active, effect=whole))
            continue
        factors = effect.factors(signals.scale)
        for drive, name in enumerate(signals.names):
            share = np.zeros_like(factors)
            share[drive] = factors[drive]
            found.append(
                replace(active, effect=DriveShare(effect, f'{effect.name}@{name}', share))
            )
    return tuple(found)


def column_of(structure: Structure, effect: str, drive: str, term: int) -> int:
    """Column of a term of an effect, of a drive's own where it has one."""
    columns = structure.columns_of(f'{effect}@{drive}') or structure.columns_of(effect)
    return columns[term]


def share_of(structure: Structure, effect: str, drive: int, names: Sequence[str]) -> Floats:
    """Factors [n] from the fitted coefficients of an effect to those of a drive."""
    for active in structure.free:
        if active.name in (effect, f'{effect}@{names[drive]}'):
            if isinstance(active.effect, DriveShare):
                return active.effect.share[drive]
            return np.ones(len(active.effect.terms))
    raise KeyError(effect)


class WholeBuilder(DesignBuilder):
    """
    Designs of the power of the robot: one column per coefficient, summed over the drives.

    Coefficients are [1, m], and so are all sizes that are [D, m] for metered drives.
    """

    def _point(self, structure: Structure, coefficients: Floats) -> Linearisation:
        """The model's own estimates at coefficients [1, m]."""
        drives = len(self.prepared.signals.names)
        return super()._point(structure, np.repeat(coefficients[:1], drives, axis=0))

    def columns(self, active: Active, point: Linearisation) -> Floats:
        """Reduced derivatives of the robot's power, [N, 1, n]."""
        return super().columns(active, point).sum(axis=1, keepdims=True)

    def constant(self, point: Linearisation, columns: Floats) -> Floats:
        """Return the part of the robot's power at the point that its columns lack, W [N, 1]."""
        power = self.prepared.reduced(point.power).sum(axis=1, keepdims=True)
        known: Floats = np.einsum('tdn,dn->td', columns, point.coefficients[:1])
        return power - known
