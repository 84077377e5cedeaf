"""Linearised problem of one meter, and what some of its columns take over of others."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.arrays import Floats

from power_estimator.effects.fit.design import Active


@dataclass(frozen=True)
class EffectColumns:
    """Linearised problem of one meter: watts per unit of prior spread at N rows."""

    actives: tuple[Active, ...]
    effects: Floats  # [N, n], scaled to the rms power
    watts: Floats  # [n], coefficient in SI for one unit of effects
    nuisance: Floats  # [N, z], prior spread 1: sensors and departures
    bent: Floats  # [N, b], prior spreads of DEPARTING: smooth departures
    absent_places: NDArray[np.intp]  # places among the meter's absent effects
    constant: Floats  # W [N]
    friction: Floats  # [n + z], weights of the friction at 1 rad/s
    causes: tuple[str, ...]  # of departures, of the discrepancy's features and of bent columns

    def places(self, active: Active) -> slice:
        """Columns of an effect."""
        start = 0
        for one in self.actives:
            stop = start + len(one.effect.terms)
            if one is active:
                return slice(start, stop)
            start = stop
        raise KeyError(active.name)

    def taken(self, actives: Sequence[Active]) -> 'EffectColumns':
        """Return some effects beside the same nuisances; not for `normals` or the friction."""
        own = np.concatenate([np.r_[self.places(active)] for active in actives])
        effects, watts = self.effects[:, own], self.watts[own]
        return replace(self, actives=tuple(actives), effects=effects, watts=watts)

    def beside_gain(self, places: slice | NDArray[np.intp] = slice(None)) -> Floats:
        """Columns of effects at places, and what the meter's gain changes [N, n + 1]."""
        return np.concatenate([self.effects[:, places], self.constant[:, None]], axis=1)

    def places_of(self, names: Sequence[str]) -> NDArray[np.intp]:
        """Columns of effects by name."""
        owners = [active.name for active in self.actives for _ in active.effect.terms]
        return np.flatnonzero(np.isin(owners, list(names)))


def apart(
    columns: EffectColumns, used: NDArray[np.bool_], places: slice, names: Sequence[str]
) -> Floats:
    """Columns of an effect less what others by name, and the meter's gain, take over [N, n].

    A gain changes what has no coefficient, the shaft's power: the rest is up to coefficients.
    """
    taken = columns.places_of(names)
    taken = taken[(taken < places.start) | (taken >= places.stop)]
    return less(columns.effects[:, places], columns.beside_gain(taken), used)


def explained(
    columns: EffectColumns,
    used: NDArray[np.bool_],
    active: Active,
    values: Floats,
    names: Sequence[str],
) -> Floats:
    """W rms [s] of an effect's coefficients [s, n] that others by name cannot take over."""
    own = apart(columns, used, columns.places(active), names)[used]
    gram = own.T @ own / len(own)
    return np.sqrt(np.maximum(np.einsum('si,ij,sj->s', values, gram, values), 0.0))


def less(own: Floats, base: Floats, used: NDArray[np.bool_]) -> Floats:
    """Columns [N, n] less their regression on others [N, m] over the used rows."""
    base = base / np.maximum(np.sqrt(np.mean(base[used] ** 2, axis=0)), 1e-12)
    weights, *_ = np.linalg.lstsq(base[used], own[used], rcond=None)
    return np.asarray(own - base @ weights)
