"""Power model of named effects: structure, coefficients and history."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Final, Literal

import numpy as np
from power_recordings.alignment.dataset import AlignedDataset
from wattwalk_core.arrays import Floats, Singles
from wattwalk_core.errors import InputError

from power_estimator.drive_types import DriveType, owners
from power_estimator.effects.catalogue import regressors_of
from power_estimator.effects.effect import Effect, Shape, Term
from power_estimator.effects.fit.design import Active, BasePower, Prior, Structure, evaluate
from power_estimator.effects.signals.prepared import signals_of
from power_estimator.effects.signals.scale import REFERENCE, DriveScale
from power_estimator.effects.signals.sizing import with_torque, with_voltage
from power_estimator.effects.signals.state import Carried, Signals
from power_estimator.effects.split import split
from power_estimator.model import Needs, PowerModel

RATE: Final = 400.0  # Hz of the samples that effects multiply, not smoothed
_OPTIONAL: Final = ('position', 'voltage', 'temperature')  # inputs beside torque and speed
_DRAWN: Final = {
    'torque': (0.0, 20.0),
    'velocity': (0.0, 3.0),
    'position': (0.0, 5.0),
    'voltage': (48.0, 5.0),
    'temperature': (40.0, 5.0),
}
"""Mean and spread of the signals on which needs are found."""
_ROWS = (4, 8, 16, 32)  # of memory that is tried; derivatives see three
_ALL = 512
_ENDS = (*range(_ALL // 2, _ALL, _ALL // 16), _ALL)  # rows that are judged: at one, little may act
_FORGOTTEN = 0.05  # share of each term's size that an older past may change


def needs_of(effect: Effect, shape: Shape, names: Sequence[str]) -> Needs:
    """Return the needs of an effect with this shape in drives of these names, found by trial."""
    random = np.random.default_rng(0)
    given = {
        name: middle + spread * random.normal(size=(2, _ALL, len(names)))
        for name, (middle, spread) in _DRAWN.items()
    }
    first = {name: values[0] for name, values in given.items()}
    data = AlignedDataset.blank(RATE, names, np.arange(_ALL) / RATE, 'random', **first)

    def regressors(signals: Signals) -> Floats:
        return regressors_of(effect, signals, shape)

    signals, carried = signals_of(data), Carried()
    whole = regressors(replace(signals, carried=carried))
    inputs = {
        name
        for name in _OPTIONAL
        if not np.array_equal(regressors(replace(signals, **{name: given[name][1]})), whole)
    }
    if not whole.any():  # of a user's effect in drives that it names itself
        code = getattr(effect.regressors, '__code__', None)
        inputs = set(_OPTIONAL) & set(code.co_names if code else ())

    def last(rows: int) -> Floats:
        """Regressors at the ends, of so many rows before each."""
        parts = (data.rows(slice(max(end - rows, 0), end)) for end in _ENDS)
        return np.stack([regressors(signals_of(part))[-1] for part in parts])

    memory = np.inf
    if not effect.remembers:
        of_all, size = last(_ALL), np.square(whole).mean(axis=(0, 1))
        for rows in _ROWS:
            if (np.square(last(rows) - of_all).mean(axis=(0, 1)) <= _FORGOTTEN**2 * size).all():
                memory = rows / RATE
                break
    return Needs(
        inputs={name: effect.name for name in sorted(inputs - {'voltage'})},
        rate=RATE,
        smooth=False,
        improved_by={'voltage': effect.name} if 'voltage' in inputs else {},
        memory=memory,
        remembers=effect.name,
        carried=carried.used or bool(np.isfinite(memory)),
        together='' if Active.of(effect, shape).per_drive else effect.name,
    )


NOMINAL_VOLTAGE = 48.0
_UNIT_SPREAD = 0.2


@dataclass(frozen=True)
class FittedValue:
    """Fitted number with its 95 % interval, in the unit of its term."""

    value: float
    interval: tuple[float, float]
    at_bound: Literal['', 'lower', 'upper'] = ''  # the catalogue's bound that it lies at

    def within(self, low: float, high: float) -> 'FittedValue':
        """Return the value with the interval [low, high], widened to hold the value."""
        return replace(self, interval=(min(low, self.value), max(high, self.value)))


@dataclass(frozen=True)
class DriveGroup:
    """Drives of a type, which share coefficients, with what was fitted to them."""

    type: DriveType
    coefficients: Mapping[str, tuple[FittedValue, ...]]  # by effect, one per term
    measurement: Mapping[str, FittedValue]  # of the recordings it was fitted on
    velocity_lag: float = 0.0  # s, of the velocity's filter
    voltage: float = NOMINAL_VOLTAGE  # V, where none is measured
    copper: float = 0.0  # W/(N·m)², copper loss of a base model, per torque²
    base_factor: float | None = None  # W per unit of the proxy that is the base
    scale: tuple[float, ...] = REFERENCE  # factors of DriveScale
    torque_constant: float | None = None  # N·m/A, for drives that have a current for torque

    @property
    def delay(self) -> float:
        """Delay of the power against the joint signals, s; 0 of operating points."""
        found = self.measurement.get('time_offset')
        return 0.0 if found is None else found.value


@dataclass(frozen=True)
class KnownDrives:
    """Drives of a dataset that a model knows, with their coefficients."""

    columns: list[int]
    names: tuple[str, ...]
    groups: list[DriveGroup]
    coefficients: Floats  # [D, m]
    lag: Floats  # s [D]
    copper: Floats  # W/(N·m)² [D]
    scale: DriveScale


@dataclass(frozen=True, repr=False)
class EffectModel:
    """Active effects and, once fitted, their coefficients by drive type or by drive.

    Implements PowerModel. Effects may be added to a base model's power (`ppn:RUN` or a proxy).
    """

    name: str
    structure: Structure
    groups: tuple[DriveGroup, ...] = ()
    base: str | None = None
    metered: Literal['drives', 'robot'] = 'drives'  # whose power it was fitted to
    fitted_on: tuple[Mapping[str, str], ...] = ()  # name and sha256
    history: tuple[Mapping[str, Any], ...] = ()
    prior: Prior = field(default_factory=dict)  # where its coefficients were expected
    base_model: PowerModel | None = field(default=None, compare=False)

    def __str__(self) -> str:
        lines = [f'{self.name}: {", ".join(self.effects)}']
        for group in self.groups:
            for active in self.structure.free:
                own = group.coefficients.get(active.name, ())
                for term, one in zip(active.effect.terms, own, strict=False):
                    low, high = one.interval
                    bounds = f'({low:.3g} … {high:.3g}) {term.unit}'
                    at = f', at its {one.at_bound} bound' if one.at_bound else ''
                    what = f'{group.type.name}  {active.name}  {term.symbol}'
                    lines.append(f'{what} = {one.value:.3g} {bounds}{at}')
        return '\n'.join(lines)

    __repr__ = __str__

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the active effects."""
        return self.structure.names

    @cached_property
    def needs(self) -> Needs:
        """Inputs and memory of its effects and of its base model."""
        return self.needs_in([group.type.patterns[0] for group in self.groups] or ['drive'])

    def needs_in(self, names: Sequence[str]) -> Needs:
        """Return the needs in drives of these names; users' effects may depend on names."""
        parts = [needs_of(a.effect, a.parameters, names) for a in self.structure.actives]
        own = Needs({'torque': '', 'velocity': ''}, RATE, smooth=False)
        if self.base_model is not None:
            parts.insert(0, self.base_model.needs)
        return own.joined(parts)

    @property
    def fitted(self) -> bool:
        """True if the model has coefficients."""
        return bool(self.groups)

    def predict(self, data: AlignedDataset, *, base: Floats | Singles | None = None) -> Singles:
        """Return the electrical power in W [T, D]; NaN for drives of no known type.

        base: power of the base model on the same samples, W [T, D], where it is known already.
        InputError for a model that is not fitted.
        """
        result = np.full(data.torque.shape, np.nan, np.float32)
        seen = self._seen(data, base)
        if seen is not None:
            order, coefficients, signals, layer = seen
            result[:, order] = evaluate(self.structure, coefficients, signals, layer)
        return result

    def by_part(
        self,
        data: AlignedDataset,
        *,
        base: Floats | Singles | None = None,
        carried: Carried | None = None,
    ) -> dict[str, Floats]:
        """Return power by effect, and of the base model as `base`, W [T, D]; else as `predict`.

        carried: memory of the effects, for data that come block by block.
        """
        seen = self._seen(data, base, carried)
        if seen is None:
            return {}
        order, coefficients, signals, layer = seen
        parts = split(self.structure, coefficients, signals, layer, slopes=False).parts
        if len(order) == len(data.names):
            return dict(parts)
        found = {name: np.full(data.torque.shape, np.nan) for name in parts}
        for name, values in parts.items():
            found[name][:, order] = values
        return found

    def _seen(
        self,
        data: AlignedDataset,
        base: Floats | Singles | None,
        carried: Carried | None = None,
    ) -> tuple[list[int], Floats, Signals, BasePower | None] | None:
        """Columns of the drives that it knows, their coefficients, signals and base power."""
        if not self.fitted:
            raise InputError(
                f'{self.name}: the model has no coefficients yet; fit it first (ros2 run '
                'power_lab fit)'
            )
        if base is None and self.base is not None:
            if self.base_model is None:
                raise InputError(f'{self.name}: its base model {self.base} is not loaded')
            base = self.base_model.predict(data)
        known = self._known(data.names)
        if not known.names:
            return None
        nominal = np.array([group.voltage for group in known.groups], dtype=np.float32)
        used = with_voltage(data.drives(known.names), nominal)
        groups = zip(used.names, known.groups, strict=True)
        constants = {n: _constant(n, g) for n, g in groups if n in used.current_as_torque}
        used = with_torque(used, constants)
        signals = replace(signals_of(used, known.lag, known.scale), carried=carried)
        layer = None
        if base is not None:
            power = np.asarray(base[:, known.columns], dtype=np.float64)
            layer = BasePower(power, known.copper)
        return known.columns, known.coefficients, signals, layer

    def _known(self, names: tuple[str, ...]) -> KnownDrives:
        if names not in self._known_by_names:
            found = enumerate(owners(names, self.groups))
            pairs = [(column, group) for column, group in found if group is not None]
            columns, groups = [column for column, _ in pairs], [group for _, group in pairs]
            self._known_by_names[names] = KnownDrives(
                columns,
                tuple(names[column] for column in columns),
                groups,
                self.coefficients(groups),
                np.array([group.velocity_lag for group in groups]),
                np.array([group.copper for group in groups]),
                DriveScale.stack([group.scale for group in groups]),
            )
        return self._known_by_names[names]

    @cached_property
    def _known_by_names(self) -> dict[tuple[str, ...], KnownDrives]:
        """Kept, since a live estimate asks for the same drives with each block of samples."""
        return {}

    def coefficients(self, members: Sequence[DriveGroup]) -> Floats:
        """Return the coefficients [D, m] of the effects for the group of each of D drives.

        Coefficients that hold for the fitted recordings alone are 0.
        """
        rows = [
            [
                0.0 if term.of_recording else found.value
                for active in self.structure.free
                for term, found in by_term(active, group)
            ]
            for group in members
        ]
        return np.array(rows, dtype=np.float64).reshape(len(members), len(self.structure.labels))

    @property
    def at_bound(self) -> tuple[str, ...]:
        """Coefficients at a bound, as `MOTOR_A copper_loss k (lower)`."""
        found: list[tuple[str, FittedValue]] = []
        for group in self.groups:
            kind = group.type.name
            for active in self.structure.free:
                values = by_term(active, group)
                found += [(f'{kind} {active.name} {term.symbol}', own) for term, own in values]
            found += [(f'{kind} {name}', own) for name, own in group.measurement.items()]
        return tuple(f'{name} ({own.at_bound})' for name, own in found if own.at_bound)

    @property
    def stranded(self) -> tuple[tuple[str, str, str], ...]:
        """Effects that are part of one whose coefficients are 0: (group, effect, that one)."""
        parts = [a for a in self.structure.free if a.effect.part_of in self.effects]
        return tuple(
            (group.type.name, part.name, part.effect.part_of)
            for group in self.groups
            for part in parts
            if all(own.at_bound == 'lower' for own in group.coefficients[part.effect.part_of])
            and any(own.value > 0.0 for own in group.coefficients[part.name])
        )

    def as_prior(self) -> Prior:
        """Return the coefficients of this model of one group as a prior for a drive like it.

        Standard deviations combine half of the interval and a fifth, by which drives of one make
        differ. They are infinite for what stands at a bound or holds for the fitted recordings
        alone.
        """
        (group,) = self.groups
        return {
            active.name: tuple(
                (0.0, np.inf)
                if own.at_bound or term.of_recording
                else (own.value, _spread(own) or np.inf)
                for term, own in by_term(active, group)
            )
            for active in self.structure.free
        }

    def with_history(self, *entries: Mapping[str, Any]) -> 'EffectModel':
        """Return the model with these entries as its whole history."""
        return replace(self, history=tuple(entries))


def by_term(active: Active, group: DriveGroup) -> Iterable[tuple[Term, FittedValue]]:
    """Return an effect's terms with what was fitted to a group."""
    return zip(active.effect.terms, group.coefficients[active.name], strict=True)


def _spread(own: FittedValue) -> float:
    return float(np.hypot(np.ptp(own.interval) / 2, _UNIT_SPREAD * own.value))


def _constant(drive: str, group: DriveGroup) -> float:
    if group.torque_constant is None:
        raise InputError(
            f'{drive} has a current for torque, but the model was fitted to a torque in N·m; fit '
            'it on recordings like this one'
        )
    return group.torque_constant
