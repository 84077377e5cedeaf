"""The linearised design of a model of effects: one reduced column per coefficient."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from wattwalk_core.arrays import Bools, Floats

from power_estimator.effects import Effect, Shape, Signals, Term
from power_estimator.effects.catalogue import regressors_of
from power_estimator.effects.signals.prepared import rate_of
from power_estimator.effects.signals.scale import DriveScale

Prior = Mapping[str, Sequence[tuple[float, float]]]
"""Expected coefficient and its spread, by effect and term."""


@dataclass(frozen=True)
class Active:
    """Effect with a choice of its shape parameters."""

    effect: Effect
    shape: tuple[tuple[str, float], ...] = ()

    @classmethod
    def of(cls, effect: Effect, shape: Shape | None = None) -> 'Active':
        """Make an active effect with the given shape, or its first."""
        return cls(effect, tuple((shape if shape is not None else effect.shapes[0]).items()))

    @property
    def name(self) -> str:
        """Name of the effect."""
        return self.effect.name

    @property
    def key(self) -> tuple[object, ...]:
        """Name and shape, which identify its regressors."""
        return (self.effect.name, self.shape)

    @property
    def parameters(self) -> dict[str, float]:
        """Shape parameters by name."""
        return dict(self.shape)

    @property
    def per_drive(self) -> bool:
        """True if each drive's regressors come from its own signals alone."""
        shape = {**self.effect.shapes[0], **self.parameters}
        return self.effect.per_drive and not shape.get(self.effect.together_by)

    def columns(self, signals: Signals) -> Floats:
        """Return the regressors [T, D, n] on signals, as `regressors_of`."""
        return regressors_of(self.effect, signals, self.parameters)


def discrepancy_of(effect: Effect) -> Effect | None:
    """Return how real drives depart from an effect's formula, as an effect; None if not known."""
    values = effect.discrepancy
    if values is None or effect.kind != 'physics' or effect.discrepancy_limit <= 0.0:
        return None
    return Effect(
        name=f'{effect.name}~',
        physics='the effect as real drives have it, not quite the formula',
        formula='see the effect',
        terms=(Term('share', '1', -10.0, 10.0),),
        regressors=lambda signals, **shape: values(signals, **shape)[..., None],
        kind='discrepancy',
        acts_on=effect.acts_on,
        follows=effect.follows,
        per_drive=effect.per_drive,
        discrepancy_limit=effect.discrepancy_limit,
        departs_from=effect.name,
    )


@dataclass(frozen=True)
class Structure:
    """Effects of a model in order, measurement terms among them; ValueError for one twice."""

    actives: tuple[Active, ...]

    def __post_init__(self) -> None:
        names = [active.name for active in self.actives]
        if len(set(names)) < len(names):
            raise ValueError(f'an effect twice in {names}')

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects."""
        return tuple(active.name for active in self.actives)

    @property
    def free(self) -> tuple[Active, ...]:
        """Effects with coefficients to fit; their terms are the m columns."""
        return tuple(active for active in self.actives if active.effect.fixed is None)

    @property
    def terms(self) -> list[Term]:
        """Terms of the m columns."""
        return [term for active in self.free for term in active.effect.terms]

    @property
    def labels(self) -> tuple[tuple[str, int], ...]:
        """Name of the effect and index of its term for each of the m columns."""
        return tuple(
            (active.name, term) for active in self.free for term in range(len(active.effect.terms))
        )

    def bounds(self, coefficients: Floats, scale: DriveScale) -> tuple[Floats, Floats]:
        """Return lower and upper bounds [D, m] of the coefficients of drives of a scale.

        A discrepancy is bounded by a share of its effect's coefficient in coefficients [D, m].
        """
        factors = self._factors(scale)
        lower = np.array([term.lower for term in self.terms]) * factors
        upper = np.array([term.upper for term in self.terms]) * factors
        for active in self.free:
            if active.effect.kind == 'discrepancy':
                column = self.columns_of(active.name)[0]
                parents = self.columns_of(active.effect.departs_from)
                size = np.abs(coefficients[:, parents]).sum(axis=1) if parents else 0.0
                upper[:, column] = active.effect.discrepancy_limit * size
                lower[:, column] = -upper[:, column]
        return lower, upper

    def priors(self, scale: DriveScale) -> Floats:
        """Return standard deviations of priors around 0 [D, m], infinite without a prior."""
        return np.array([term.prior for term in self.terms]) * self._factors(scale)

    def expected(self, prior: Prior) -> tuple[Floats, Floats]:
        """Return expected value and standard deviation [m], which is infinite without a prior."""
        nothing = (0.0, np.inf)
        found = [
            own
            for active in self.free
            for own in prior.get(active.name, (nothing,) * len(active.effect.terms))
        ]
        table = np.array(found, np.float64).reshape(-1, 2)
        return table[:, 0], table[:, 1]

    def _factors(self, scale: DriveScale) -> Floats:
        parts = [active.effect.factors(scale) for active in self.free]
        return np.concatenate([np.empty((len(scale.torque), 0)), *parts], axis=1)

    def coupled(self, coefficients: Floats) -> Bools:
        """Mark the columns [m] whose coefficients change the columns of others.

        All of them where an effect with coefficients in [D, m] follows the power that is drawn.
        """
        owners = [active for active in self.free for _ in active.effect.terms]
        drawn = [
            'drawn' in active.effect.follows and bool(coefficients[:, column].any())
            for column, active in enumerate(owners)
        ]
        moves = [
            active.effect.acts_on != 'power' or 'motor_torque' in active.effect.follows
            for active in owners
        ]
        return np.array(moves, dtype=bool) | any(drawn)

    def with_discrepancies(self) -> 'Structure':
        """Return the structure with the discrepancy of each effect that has one, see `Effect`."""
        found = [(active, discrepancy_of(active.effect)) for active in self.actives]
        new = [
            replace(active, effect=effect)
            for active, effect in found
            if effect is not None and effect.name not in self.names
        ]
        return self.plus(*new)

    def columns_of(self, name: str) -> list[int]:
        """Return the indices of an effect's columns; none for a name that is not there."""
        return [i for i, (owner, _) in enumerate(self.labels) if owner == name]

    def plus(self, *actives: Active) -> 'Structure':
        """Return the structure with more effects."""
        return Structure((*self.actives, *actives))

    def without(self, name: str) -> 'Structure':
        """Return the structure without an effect."""
        return Structure(tuple(active for active in self.actives if active.name != name))


@dataclass(frozen=True)
class Design:
    """Structure linearised about one set of coefficients.

    The reduced power of the model, W [N, D], is columns · coefficients + constant.
    """

    structure: Structure
    columns: Floats  # [N, D, m]
    constant: Floats  # W [N, D]
    lower: Floats  # [D, m]
    upper: Floats  # [D, m]


@dataclass(frozen=True)
class BasePower:
    """Power of a base model that effects are added to."""

    power: Floats  # W [T, D]
    copper: Floats  # W/(N·m)² [D], what torque costs in it, for torque that effects add

    def drive(self, index: int) -> 'BasePower':
        """Return power and copper loss of one drive, D = 1."""
        own = np.ascontiguousarray(self.power[:, index : index + 1])
        return BasePower(own, self.copper[[index]])


Source = Callable[[Active, Signals], Floats]


def estimates(
    structure: Structure,
    coefficients: Floats,
    signals: Signals,
    base: BasePower | None = None,
    source: Source = Active.columns,
) -> Signals:
    """Return the signals with the model's estimates of motor motion, torque and drawn power.

    coefficients: [D, m]; base: power of a base model; source: gives the regressors of an effect.
    """
    parts = by_effect(structure, coefficients)
    signals = _with_motion(parts, signals, source)
    torque = np.zeros_like(signals.torque)
    for follows in (False, True):
        before = replace(signals, motor_torque=signals.torque + torque) if follows else signals
        for active, own in parts:
            second = 'motor_torque' in active.effect.follows
            if active.effect.acts_on == 'torque' and second is follows and own.any():
                torque = torque + weighted(source(active, before), own)
    signals = replace(signals, motor_torque=signals.torque + torque)
    cost = np.zeros_like(torque)
    if base is not None:
        cost += 2.0 * base.copper * signals.motor_torque
    for active, own in parts:
        by_torque = active.effect.torque_slope if own.any() else None
        slope = by_torque and by_torque(signals, own[None])
        if slope is not None:
            cost += slope
    signals = replace(signals, torque_cost=cost)
    drawn = torque * signals.motor_velocity
    if signals.motor_velocity is not signals.velocity:
        drawn += signals.torque * (signals.motor_velocity - signals.velocity)
    if base is not None:
        added = np.square(signals.motor_torque) - np.square(signals.torque)
        drawn += base.power + base.copper * added
    for active in structure.actives:
        if active.effect.fixed is not None:
            drawn += active.effect.fixed * source(active, signals)[..., 0]
    for active, own in parts:
        power = active.effect.acts_on == 'power' and 'drawn' not in active.effect.follows
        if power and own.any():
            added = weighted(source(active, signals), own)
            drawn += added
            if active.name == 'idle':
                signals = replace(signals, electronics=added)
    return replace(signals, drawn=drawn)


def evaluate(
    structure: Structure, coefficients: Floats, signals: Signals, base: BasePower | None = None
) -> Floats:
    """Return the power of a model with coefficients [D, m], W [T, D] at the rate of signals."""
    signals = estimates(structure, coefficients, signals, base)
    power = signals.drawn
    for active, own in by_effect(structure, coefficients):
        if 'drawn' in active.effect.follows and own.any():
            power = power + weighted(active.columns(signals), own)
    return power


def _with_motion(
    parts: Sequence[tuple[Active, Floats]], signals: Signals, source: Source
) -> Signals:
    extra = np.zeros_like(signals.velocity)
    for active, own in parts:
        if active.effect.acts_on == 'speed' and own.any():
            extra += weighted(source(active, signals), own)
    if not extra.any():
        return signals
    acceleration = signals.acceleration + rate_of(extra, signals.stretches(), signals.rate)
    return replace(
        signals, motor_velocity=signals.velocity + extra, motor_acceleration=acceleration
    )


def weighted(columns: Floats, coefficients: Floats) -> Floats:
    """Return columns [T, D, n] times coefficients [D, n], summed to [T, D]."""
    if columns.shape[1] == 1 and columns.shape[2] > 1:
        return np.asarray(columns[:, 0] @ coefficients[0])[:, None]
    total = columns[..., 0] * coefficients[:, 0]
    for term in range(1, coefficients.shape[1]):
        total += columns[..., term] * coefficients[:, term]
    return total


def by_effect(structure: Structure, coefficients: Floats) -> Sequence[tuple[Active, Floats]]:
    """Return each effect with its part [D, n] of coefficients [D, m]."""
    place, out = 0, []
    for active in structure.free:
        count = len(active.effect.terms)
        out.append((active, coefficients[:, place : place + count]))
        place += count
    return out
