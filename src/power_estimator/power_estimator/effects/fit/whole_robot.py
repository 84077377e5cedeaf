"""Fits to the power of a whole robot, of which no drive was metered by itself."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from wattwalk_core.arrays import Floats

from power_estimator.effects import Effect, Signals
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.effects.fit.design_builder import DesignBuilder, Linearisation
from power_estimator.effects.signals.prepared import Prepared

COMMON = frozenset({'idle', 'regeneration_limit', 'line_resistance'})
"""Effects of the robot's supply as a whole: drives cannot be told apart by them."""


def drive_share(of: Effect, name: str, share: Floats) -> Effect:
    """Return an effect of some drives of a robot, as its one meter shows it, under a name.

    share [D, n]: factor of each drive's regressors, with the drive's size; 0 for drives without
    the effect.
    """
    torque_slope, drawn_slope, discrepancy = of.torque_slope, of.drawn_slope, of.discrepancy
    return replace(
        of,
        name=name,
        per_drive=False,
        regressors=lambda signals, **shape: np.asarray(of.regressors(signals, **shape)) * share,
        torque_slope=torque_slope and (lambda signals, own: torque_slope(signals, own * share)),
        drawn_slope=drawn_slope
        and (lambda signals, own, **shape: drawn_slope(signals, own * share, **shape)),
        discrepancy=discrepancy
        and (lambda signals, **shape: discrepancy(signals, **shape) * share[:, 0]),
        sizes=lambda scale: np.ones((len(scale.torque), len(of.terms))),
        scaled=None,
        made=(drive_share, (of, name, share)),
    )


def has_one_share(effect: Effect) -> bool:
    """Return whether a robot has one coefficient of the effect, whatever its drives are."""
    return effect.kind != 'physics' or effect.fixed is not None or effect.name in COMMON


def shared_by_size(effect: Effect, signals: Signals) -> Effect:
    """Return the effect with one coefficient for all drives, in proportion to their sizes."""
    if has_one_share(effect):
        return effect
    return drive_share(effect, effect.name, effect.factors(signals.scale))


def expanded(actives: Sequence[Active], signals: Signals) -> tuple[Active, ...]:
    """Return effects as a robot's one meter may show them: with a coefficient for each drive.

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
                replace(active, effect=drive_share(effect, f'{effect.name}@{name}', share))
            )
    return tuple(found)


def column_of(structure: Structure, effect: str, drive: str, term: int) -> int:
    """Return the column of an effect's term: that of the drive, where it has one."""
    columns = structure.columns_of(f'{effect}@{drive}') or structure.columns_of(effect)
    return columns[term]


def share_of(effect: Effect, prepared: Prepared, drive: int) -> Floats:
    """Return factors [n] from the fitted coefficients of an effect to those of one drive."""
    if not prepared.whole or has_one_share(effect):
        return np.ones(len(effect.terms))
    return effect.factors(prepared.signals.scale)[drive]


def shares_of_drives(effect: Effect) -> Floats | None:
    """Return factors [D, n] from an effect's coefficients to its drives'; None if they are one."""
    function, arguments = effect.made or (None, ())
    return arguments[2] if function is drive_share else None


class WholeBuilder(DesignBuilder):
    """Builder of designs of a robot's one meter: a column per coefficient, summed over drives.

    Coefficients are [1, m], and so are all sizes that are [D, m] for metered drives.
    """

    def _point(self, structure: Structure, coefficients: Floats) -> Linearisation:
        """The model's own estimates at coefficients [1, m]."""
        drives = len(self.prepared.signals.names)
        return super()._point(structure, np.repeat(coefficients[:1], drives, axis=0))

    def _seen(self, power: Floats) -> Floats:
        """What the meter sees of the drives' power [T, D, n]: their sum [T, 1, n]."""
        return power.sum(axis=1, keepdims=True)

    def constant(self, point: Linearisation, columns: Floats) -> Floats:
        """Return the part of the robot's power at a point that is not in columns, W [N, 1]."""
        power = self.prepared.reduced(self._seen(point.power))
        known: Floats = np.einsum('tdn,dn->td', columns, point.coefficients[:1])
        return power - known
