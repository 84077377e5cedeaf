"""Catalogue of effects: those shipped and those of users' files."""

import inspect
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import ModuleType

import numpy as np
from wattwalk_core.errors import InputError
from wattwalk_core.quoting import quoted
from wattwalk_core.yaml_file import read_text

from power_estimator.effects.effect import Effect, Excitation, Floats, Shape, Term
from power_estimator.effects.library.cogging import Cogging
from power_estimator.effects.library.copper_loss import CopperLoss
from power_estimator.effects.library.coulomb_friction import CoulombFriction
from power_estimator.effects.library.field_weakening import FieldWeakening
from power_estimator.effects.library.idle import Idle
from power_estimator.effects.library.inverter_loss import InverterLoss
from power_estimator.effects.library.iron_loss import IronLoss
from power_estimator.effects.library.line_resistance import LineResistance
from power_estimator.effects.library.load_friction import LoadFriction
from power_estimator.effects.library.measurement import (
    CurrentOffset,
    OffsetDrift,
    PowerGain,
    TimeOffset,
    TorqueBias,
    TorqueNonlinearity,
    VelocityLag,
)
from power_estimator.effects.library.regeneration_efficiency import RegenerationEfficiency
from power_estimator.effects.library.regeneration_limit import RegenerationLimit
from power_estimator.effects.library.rotor_inertia import RotorInertia
from power_estimator.effects.library.shaft import Shaft
from power_estimator.effects.library.spring import Spring
from power_estimator.effects.library.stribeck_friction import StribeckFriction
from power_estimator.effects.library.viscous_friction import ViscousFriction
from power_estimator.effects.library.winding_heating import WindingHeating
from power_estimator.effects.signals.state import Signals

_BUILTIN: tuple[type[Effect], ...] = (
    Shaft,
    CopperLoss,
    WindingHeating,
    ViscousFriction,
    CoulombFriction,
    StribeckFriction,
    LoadFriction,
    IronLoss,
    InverterLoss,
    Idle,
    RegenerationEfficiency,
    RegenerationLimit,
    FieldWeakening,
    RotorInertia,
    Spring,
    Cogging,
    LineResistance,
    PowerGain,
    CurrentOffset,
    TorqueBias,
    TorqueNonlinearity,
    VelocityLag,
    OffsetDrift,
    TimeOffset,
)


class Catalogue(Mapping[str, Effect]):
    """Effects by name, in a fixed order."""

    def __init__(self, effects: Sequence[Effect], origins: Mapping[str, Path] | None = None):
        self._effects = {effect.name: effect for effect in effects}
        self.origins = dict(origins or {})

    def __getitem__(self, name: str) -> Effect:
        return self._effects[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._effects)

    def __len__(self) -> int:
        return len(self._effects)

    def __reduce__(self) -> tuple[object, ...]:
        """Travel as the names of files: a user's classes are in no module of others."""
        files = dict.fromkeys(path.absolute() for path in self.origins.values())
        return load_catalogue, (tuple(files),)

    def get_known(self, name: str, where: str) -> Effect:
        """Return the effect of that name; InputError, with the names there are, for another."""
        if name not in self._effects:
            raise InputError(
                f'{where}: unknown effect {name!r}; known are {", ".join(self._effects)}'
                ' (your own go by --effects-path FILE.py)'
            )
        return self._effects[name]

    def physics(self) -> tuple[Effect, ...]:
        """Effects of the drive."""
        return tuple(effect for effect in self._effects.values() if effect.kind == 'physics')

    def measurement(self) -> tuple[Effect, ...]:
        """Faults of the measurement."""
        return tuple(effect for effect in self._effects.values() if effect.kind == 'measurement')


def builtin_catalogue() -> Catalogue:
    """Return the shipped effects."""
    return Catalogue([effect() for effect in _BUILTIN])


def load_catalogue(paths: Sequence[Path] = ()) -> Catalogue:
    """
    Return the shipped effects and those defined in the given Python files.

    The files are run: name only files that you trust. InputError if a file cannot be read or
    run, defines no effect, redefines a name, or defines one that is incomplete.
    """
    effects = [effect() for effect in _BUILTIN]
    origins: dict[str, Path] = {}
    for path in paths:
        for effect in _effects_in(path):
            if effect.name in {known.name for known in effects}:
                raise InputError(f'{path}: effect {effect.name!r} exists already; rename yours')
            effects.append(effect)
            origins[effect.name] = path
    return Catalogue(effects, origins)


def regressors_of(effect: Effect, signals: Signals, shape: Shape) -> Floats:
    """
    Return the effect's regressors [T, D, n], checked.

    Raises InputError for an effect that raises, or returns another shape or NaN.
    """
    try:
        columns = np.asarray(effect.regressors(signals, **shape), dtype=np.float64)
    except InputError:
        raise
    except Exception as error:  # a user's code may raise anything
        raise InputError(
            f'effect {effect.name!r} raised {type(error).__name__}: {error}'
        ) from error
    expected = (*signals.torque.shape, len(effect.terms))
    if columns.shape != expected:
        raise InputError(
            f'effect {effect.name!r} returned regressors of shape {columns.shape}; '
            f'[time, drive, term] is {expected}'
        )
    if not _all_finite(columns):
        raise InputError(f'effect {effect.name!r} returned NaN or infinite regressors')
    if effect.needs_joint_torque and signals.at_motor.any():
        columns = columns * ~signals.at_motor[:, None]
    return columns


def _all_finite(values: Floats) -> bool:
    """Return whether no value is NaN or infinite; one pass without a copy for those that are."""
    flat = values.ravel(order='K')
    return bool(np.isfinite(flat @ flat)) or bool(np.isfinite(values).all())


def _effects_in(path: Path) -> list[Effect]:
    module = _run(path)
    classes = [
        value
        for value in vars(module).values()
        if inspect.isclass(value)
        and issubclass(value, Effect)
        and value.__module__ == module.__name__
    ]
    if not classes:
        raise InputError(f'{path}: defines no class derived from Effect')
    return [_checked(kind, path) for kind in classes]


def _run(path: Path) -> ModuleType:
    source = read_text(path, 'effects')
    module = ModuleType(f'user_effects_{path.stem}')
    module.__file__ = str(path)
    try:
        exec(compile(source, str(path), 'exec'), vars(module))
    except (Exception, SystemExit) as error:  # a user's code may raise anything
        raise InputError(f'{path}: {type(error).__name__}: {error}') from error
    return module


def _checked(kind: type[Effect], path: Path) -> Effect:
    where = f'{path}: class {kind.__name__}'
    try:
        _check_attributes(kind, where)
        return kind()
    except InputError:
        raise
    except Exception as error:  # a user's class may hold anything
        raise InputError(f'{where}: {type(error).__name__}: {error}') from error


def _check_attributes(kind: type[Effect], where: str) -> None:
    for attribute in ('name', 'physics', 'formula', 'terms'):
        if not getattr(kind, attribute, None):
            raise InputError(f'{where} has no {attribute!r}')
    if not isinstance(kind.name, str) or not re.fullmatch(r'\w{1,64}', kind.name):
        raise InputError(f'{where}: name is letters, digits and "_", not {quoted(kind.name)}')
    if inspect.isabstract(kind):
        raise InputError(f'{where} has no method regressors(self, signals, **shape)')
    if not getattr(kind, 'excitation', None):
        kind.excitation = Excitation('not given by its author')
    for term in kind.terms:
        if not isinstance(term, Term) or not term.unit or not term.lower <= term.upper:
            raise InputError(
                f'{where}: terms are Term(symbol, unit, lower, upper); got {quoted(term)}'
            )
    if kind.acts_on not in ('power', 'torque', 'speed'):
        raise InputError(f"{where}: acts_on is 'power', 'torque' or 'speed', not {kind.acts_on!r}")
