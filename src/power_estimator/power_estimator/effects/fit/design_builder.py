"""Builds linearised designs on prepared signals."""

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np
from wattwalk_core.arrays import Floats

from power_estimator.effects import Signals
from power_estimator.effects.fit.blocks import modelled
from power_estimator.effects.fit.design import (
    Active,
    BasePower,
    Design,
    Structure,
    by_effect,
    estimates,
    weighted,
)
from power_estimator.effects.fit.settings import FitSettings
from power_estimator.effects.signals.prepared import Prepared

Value = TypeVar('Value')


class Kept(Generic[Value]):
    """Cache of values by key; those used least recently go when all need more than a budget.

    Several threads may share it.
    """

    def __init__(self, budget: int) -> None:
        """budget: bytes; the newest value stays whatever it needs."""
        self._budget = budget
        self._values: OrderedDict[Hashable, tuple[Value, int]] = OrderedDict()
        self._used, self._lock = 0, threading.RLock()

    def get(self, key: Hashable, make: Callable[[], Value], size: Callable[[Value], int]) -> Value:
        """Return the value of a key, from `make` where it is not kept; size: gives its bytes."""
        with self._lock:
            if key in self._values:
                self._values.move_to_end(key)
                return self._values[key][0]
        value = make()
        self.put(key, value, size(value))
        return value

    def put(self, key: Hashable, value: Value, size: int) -> None:
        """Keep a value of `size` bytes; those used least recently go for it."""
        with self._lock:
            _, before = self._values.pop(key, (None, 0))
            self._values[key] = (value, size)
            self._used += size - before
            while self._used > self._budget and len(self._values) > 1:
                _, (_, freed) = self._values.popitem(last=False)
                self._used -= freed


_SPEED_STEP = 1e-4  # rad/(N·m), of the difference quotient


@dataclass(frozen=True)
class Linearisation:
    """Point of linearisation of a structure, with the model's estimates there."""

    structure: Structure
    coefficients: Floats  # [D, m]
    signals: Signals
    power: Floats  # W [T, D], of the whole model
    passed: Floats | None  # slope of the whole power by the drawn power [T, D]; None for 1


class DesignBuilder:
    """Builder of designs on prepared signals; columns that no estimate changes are kept.

    It keeps one point with its columns, too: that which several fits in turn begin at.
    """

    def __init__(
        self, prepared: Prepared, base: BasePower | None = None, kept: int = FitSettings.kept
    ) -> None:
        """base: power of a base model; kept: bytes of columns at most, of either rate."""
        self.prepared = prepared
        self.base = base
        self.kept = kept
        self._reduced: Kept[Floats] = Kept(kept)
        self._instant: Kept[Floats] = Kept(kept)
        self._begun: tuple[object, Linearisation, dict[object, Floats]] | None = None

    def point(self, structure: Structure, coefficients: Floats) -> Linearisation:
        """Return the point of linearisation at coefficients [D, m], with estimates there."""
        if self._begun is not None and self._begun[0] == _place_of(structure, coefficients):
            return replace(self._begun[1], structure=structure, coefficients=coefficients)
        return self._point(structure, coefficients)

    def _point(self, structure: Structure, coefficients: Floats) -> Linearisation:
        signals = self.prepared.signals
        signals = estimates(structure, coefficients, signals, self.base, self.regressors)
        power = signals.drawn.copy()
        passed: Floats | None = None
        for active, own in by_effect(structure, coefficients):
            if 'drawn' not in active.effect.follows or not own.any():
                continue
            power += weighted(active.columns(signals), own)
            by_drawn = active.effect.drawn_slope
            slope = by_drawn and by_drawn(signals, own[None], **active.parameters)
            if slope is not None:
                passed = (1.0 if passed is None else passed) + slope
        return Linearisation(structure, coefficients, signals, power, passed)

    def build(self, structure: Structure, coefficients: Floats, *, keep: bool = False) -> Design:
        """Linearise about coefficients [D, m]; keep: hold the columns for other designs there."""
        place = _place_of(structure, coefficients)
        point = self.point(structure, coefficients)
        if keep and (self._begun is None or self._begun[0] != place):
            self._begun = place, point, {}
        known = self._begun[2] if self._begun is not None and self._begun[0] == place else {}
        columns = []
        for active in structure.free:
            if active.key not in known:
                known[active.key] = self.columns(active, point)
            columns.append(known[active.key])
        count = (len(self.prepared.time), len(self.prepared.names))
        joined = np.concatenate(columns, axis=2) if columns else np.empty((*count, 0))
        constant = self.constant(point, joined)
        return Design(
            structure, joined, constant, *structure.bounds(coefficients, self.prepared.scale)
        )

    def beside(
        self, actives: Sequence[Active], structure: Structure, coefficients: Floats
    ) -> list[Floats]:
        """Return reduced columns [N, D, n] of effects beside a structure at coefficients."""
        point = self.point(structure, coefficients)
        return [self.columns(active, point) for active in actives]

    def columns(self, active: Active, point: Linearisation) -> Floats:
        """Return reduced derivatives of the power by an effect's coefficients, [N, D, n]."""
        if self._lasts(active, point):
            return self._reduced_once(active, point.signals)
        return self.prepared.reduced(self._seen(self._derivatives(active, point)))

    def columns_and(
        self, actives: Sequence[Active], point: Linearisation, more: Sequence[Floats]
    ) -> tuple[list[Floats], Floats]:
        """Return reduced columns [N, D, n] of effects, and [N, D, k] of k powers W [T, D]."""
        parts = [
            None if self._lasts(a, point) else self._seen(self._derivatives(a, point))
            for a in actives
        ]
        given = [part for part in parts if part is not None]
        beside = [self._seen(power[..., None]) for power in more]
        joined = self.prepared.reduced(_side_by_side([*given, *beside]))
        found, start = [], 0
        for active, part in zip(actives, parts, strict=True):
            if part is None:
                found.append(self._reduced_once(active, point.signals))
            else:
                found.append(joined[..., start : start + part.shape[2]])
                start += part.shape[2]
        return found, joined[..., start:]

    def constant(self, point: Linearisation, columns: Floats) -> Floats:
        """Return the part of the power at a point that is not in its columns, W [N, D]."""
        return self.prepared.reduced(point.power) - modelled(columns, point.coefficients)

    def _seen(self, power: Floats) -> Floats:
        """What a meter sees of the drives' power [T, D, n]: that of one drive."""
        return power

    def _lasts(self, active: Active, point: Linearisation) -> bool:
        """Return whether no estimate moves the columns of an effect."""
        effect = active.effect
        return effect.acts_on == 'power' and not effect.follows and point.passed is None

    def _derivatives(self, active: Active, point: Linearisation) -> Floats:
        """Derivatives of the drives' power by one effect's coefficients, [T, D, n]."""
        signals, effect = point.signals, active.effect
        if effect.acts_on == 'speed':
            return self._by_speed(active, point)
        power = self.regressors(active, signals)
        if effect.acts_on == 'torque':
            power = power * (signals.motor_velocity + signals.torque_cost)[..., None]
        if point.passed is not None and 'drawn' not in effect.follows:
            power = power * point.passed[..., None]
        return power

    def _by_speed(self, active: Active, point: Linearisation) -> Floats:
        """Derivatives by coefficients that move the motor's speed, W per unit [T, D, n]."""
        place = point.structure.columns_of(active.name)
        structure, coefficients = point.structure, point.coefficients
        if not place:
            structure = structure.plus(active)
            place = structure.columns_of(active.name)
            extra = np.zeros((len(coefficients), len(place)))
            coefficients = np.concatenate([coefficients, extra], axis=1)
        step = _SPEED_STEP * min(1.0, float(point.signals.scale.speed.min()))
        columns = []
        for column in place:
            moved = coefficients.copy()
            moved[:, column] += step
            columns.append((self.point(structure, moved).power - point.power) / step)
        return np.stack(columns, axis=-1)

    def regressors(self, active: Active, signals: Signals) -> Floats:
        """Return regressors [T, D, n] of an effect; kept where no estimate changes them."""
        if active.effect.follows or signals.motor_velocity is not signals.velocity:
            return active.columns(signals)
        return self._instant.get(active.key, lambda: active.columns(signals), _bytes)

    def _reduced_once(self, active: Active, signals: Signals) -> Floats:
        def reduced() -> Floats:
            return self.prepared.reduced(self._seen(active.columns(signals)))

        if signals.motor_velocity is not signals.velocity:
            return reduced()
        return self._reduced.get(active.key, reduced, _bytes)


def _side_by_side(parts: Sequence[Floats]) -> Floats:
    """Columns [T, D, n] of several, each of which lies in one piece, as the reducer has them."""
    stops = np.cumsum([part.shape[2] for part in parts])
    out = np.empty((*parts[0].shape[:2], int(stops[-1])), order='F')
    for part, stop in zip(parts, stops, strict=True):
        out[..., stop - part.shape[2] : stop] = part
    return out


def _bytes(values: Floats) -> int:
    return values.nbytes


def _place_of(structure: Structure, coefficients: Floats) -> object:
    """Identity of a point: the effects that take part in it, with their coefficients."""
    fixed = tuple(active.key for active in structure.actives if active.effect.fixed is not None)
    parts = by_effect(structure, coefficients)
    return fixed, tuple((a.key, own.tobytes()) for a, own in parts if own.any())
