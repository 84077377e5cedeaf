"""The linearised design of a model of effects: one reduced column per coefficient."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from power_estimator.effect_signals import Prepared
from power_estimator.effects import Bend, Effect, Shape, Signals
from power_estimator.effects.catalogue import regressors_of

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Active:
    """An effect with its shape parameters chosen."""

    effect: Effect
    shape: tuple[tuple[str, float], ...] = ()

    @classmethod
    def of(cls, effect: Effect, shape: Shape | None = None) -> 'Active':
        """With the given shape, or the effect's first."""
        return cls(effect, tuple((shape if shape is not None else effect.shapes[0]).items()))

    @property
    def name(self) -> str:
        """Of the effect."""
        return self.effect.name

    @property
    def parameters(self) -> dict[str, float]:
        """Shape parameters by name."""
        return dict(self.shape)

    def columns(self, signals: Signals) -> Floats:
        """[T, D, n], checked."""
        return regressors_of(self.effect, signals, self.parameters)


@dataclass(frozen=True)
class Structure:
    """Which effects a model has, in order; measurement terms among them."""

    actives: tuple[Active, ...]

    def __post_init__(self) -> None:
        names = [active.name for active in self.actives]
        if len(set(names)) < len(names):
            raise ValueError(f'an effect twice in {names}')

    @property
    def names(self) -> tuple[str, ...]:
        """Effects by name."""
        return tuple(active.name for active in self.actives)

    @property
    def free(self) -> tuple[Active, ...]:
        """Effects with coefficients to fit."""
        return tuple(active for active in self.actives if active.effect.fixed is None)

    @property
    def labels(self) -> tuple[tuple[str, int], ...]:
        """(effect, term) of each of the m columns."""
        return tuple(
            (active.name, term) for active in self.free for term in range(len(active.effect.terms))
        )

    def bounds(self, coefficients: Floats) -> tuple[Floats, Floats]:
        """
        Lower and upper bound of each column [D, m].

        A bend may take a share of its effect's coefficient, as it is in coefficients [D, m].
        """
        terms = [term for active in self.free for term in active.effect.terms]
        lower = np.tile([term.lower for term in terms], (len(coefficients), 1))
        upper = np.tile([term.upper for term in terms], (len(coefficients), 1))
        for active in self.free:
            if isinstance(active.effect, Bend):
                column = self.columns_of(active.name)[0]
                parents = self.columns_of(active.effect.of.name)
                size = np.abs(coefficients[:, parents]).sum(axis=1) if parents else 0.0
                upper[:, column] = active.effect.bend_limit * size
                lower[:, column] = -upper[:, column]
        return lower, upper

    def priors(self) -> Floats:
        """Spread known beforehand of each column [m], infinite where nothing is known."""
        return np.array([term.prior for active in self.free for term in active.effect.terms])

    def bent(self) -> 'Structure':
        """With a bend beside every effect that has one."""
        bends = [
            Active(Bend(active.effect, active.parameters))
            for active in self.actives
            if active.effect.kind == 'physics'
            and active.effect.bend_limit > 0
            and f'{active.name}~' not in self.names
        ]
        return self.plus(*bends)

    def columns_of(self, name: str) -> list[int]:
        """Columns that belong to the effect."""
        return [i for i, (owner, _) in enumerate(self.labels) if owner == name]

    def plus(self, *actives: Active) -> 'Structure':
        """With more effects."""
        return Structure((*self.actives, *actives))

    def without(self, name: str) -> 'Structure':
        """With one effect less."""
        return Structure(tuple(active for active in self.actives if active.name != name))


@dataclass(frozen=True)
class Design:
    """
    A structure linearised about one set of coefficients.

    The model's reduced power is columns @ coefficients + constant.
    """

    structure: Structure
    columns: Floats  # [N, D, m]
    constant: Floats  # W [N, D]
    lower: Floats  # [D, m]
    upper: Floats  # [D, m]


@dataclass(frozen=True)
class Point:
    """Where a structure is linearised."""

    structure: Structure
    coefficients: Floats  # [D, m]
    signals: Signals  # with the model's own estimates there
    bend: Floats  # N·m [T, D], what the structure adds to the torque


class DesignBuilder:
    """Builds designs on prepared signals; keeps what no estimate moves."""

    def __init__(self, prepared: Prepared, base: Floats | None = None) -> None:
        self.prepared = prepared
        self._base = base  # W [T, D] of a model that the effects are added to
        self._reduced: dict[tuple[object, ...], Floats] = {}
        self._instant: dict[tuple[object, ...], Floats] = {}

    def point(self, structure: Structure, coefficients: Floats) -> Point:
        """The model's own estimates at coefficients [D, m]."""
        signals, bend = estimates(
            structure, coefficients, self.prepared.signals, self._base, self._columns
        )
        return Point(structure, coefficients, signals, bend)

    def build(self, structure: Structure, coefficients: Floats) -> Design:
        """Linearise about coefficients [D, m]."""
        point = self.point(structure, coefficients)
        columns = [self.columns(active, point) for active in structure.free]
        constant = self.constant(point)
        joined = np.concatenate(columns, axis=2) if columns else np.empty((*constant.shape, 0))
        return Design(structure, joined, constant, *structure.bounds(coefficients))

    def columns(self, active: Active, point: Point) -> Floats:
        """Reduced columns of one effect about the point, [N, D, n]."""
        signals = point.signals
        if active.effect.acts_on == 'torque':
            price = (signals.velocity + signals.torque_cost)[..., None]
            return self.prepared.reduced(self._columns(active, signals) * price)
        if active.effect.follows:
            return self.prepared.reduced(active.columns(signals))
        return self._reduced_once(active, signals)

    def constant(self, point: Point) -> Floats:
        """What does not depend on the coefficients, W [N, D]."""
        signals = point.signals
        constant = np.zeros((len(self.prepared.time), len(signals.names)))
        for active in point.structure.actives:
            if active.effect.fixed is not None:
                constant += active.effect.fixed * self._reduced_once(active, signals)[..., 0]
        if self._base is not None:
            if ('base',) not in self._reduced:
                self._reduced['base',] = self.prepared.reduced(self._base)
            constant += self._reduced['base',]
        if point.bend.any() and signals.torque_cost.any():
            constant -= self.prepared.reduced(signals.torque_cost * point.bend)
        return constant

    def power(self, structure: Structure, coefficients: Floats) -> Floats:
        """The model's power at the input rate, W [T, D], not linearised."""
        return evaluate(structure, coefficients, self.prepared.signals, self._base, self._columns)

    def _columns(self, active: Active, signals: Signals) -> Floats:
        if active.effect.follows:
            return active.columns(signals)
        key = (active.name, active.shape)
        if key not in self._instant:
            self._instant[key] = active.columns(signals)
        return self._instant[key]

    def _reduced_once(self, active: Active, signals: Signals) -> Floats:
        key: tuple[object, ...] = (active.name, active.shape)
        if key not in self._reduced:
            self._reduced[key] = self.prepared.reduced(active.columns(signals))
        return self._reduced[key]


Source = Callable[[Active, Signals], Floats]


def _fresh(active: Active, signals: Signals) -> Floats:
    return active.columns(signals)


def estimates(
    structure: Structure,
    coefficients: Floats,
    signals: Signals,
    base: Floats | None,
    source: Source = _fresh,
) -> tuple[Signals, Floats]:
    """
    The signals with the model's own estimates, and the torque that its effects add, N·m [T, D].

    coefficients is [D, m]; base is the power of a model underneath, W [T, D].
    """
    bend = np.zeros_like(signals.torque)
    for active, own in _split(structure, coefficients):
        if active.effect.acts_on == 'torque' and own.any():
            bend += np.einsum('tdn,dn->td', source(active, signals), own)
    motor = signals.torque + bend
    signals = signals.with_estimates(motor, signals.torque_cost, signals.drawn)
    cost = np.zeros_like(bend)
    for active, own in _split(structure, coefficients):
        slope = active.effect.torque_slope(signals, own[None]) if own.any() else None
        if slope is not None:
            cost += slope
    signals = signals.with_estimates(motor, cost, signals.drawn)
    before = bend * signals.velocity
    if base is not None:
        before += base
    for active in structure.actives:
        if active.effect.fixed is not None:
            before += active.effect.fixed * source(active, signals)[..., 0]
    before += _power_effects(structure, coefficients, signals, source, drawn=False)
    return signals.with_estimates(motor, cost, before), bend


def evaluate(
    structure: Structure,
    coefficients: Floats,
    signals: Signals,
    base: Floats | None = None,
    source: Source = _fresh,
) -> Floats:
    """Power of the model in W [T, D] at the rate of the signals."""
    signals, _ = estimates(structure, coefficients, signals, base, source)
    return signals.drawn + _power_effects(structure, coefficients, signals, source, drawn=True)


def _power_effects(
    structure: Structure, coefficients: Floats, signals: Signals, source: Source, *, drawn: bool
) -> Floats:
    """Summed power of the effects that follow the drawn power, or of all the others."""
    total = np.zeros_like(signals.torque)
    for active, own in _split(structure, coefficients):
        if active.effect.acts_on == 'torque' or ('drawn' in active.effect.follows) is not drawn:
            continue
        if own.any():
            total += np.einsum('tdn,dn->td', source(active, signals), own)
    return total


def _split(structure: Structure, coefficients: Floats) -> Sequence[tuple[Active, Floats]]:
    place, out = 0, []
    for active in structure.free:
        count = len(active.effect.terms)
        out.append((active, coefficients[:, place : place + count]))
        place += count
    return out
