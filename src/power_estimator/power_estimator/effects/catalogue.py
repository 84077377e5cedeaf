"""Catalogue of effects: those shipped and those of users' files."""

import copyreg
import inspect
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError, quoted
from wattwalk_core.yaml_file import read_text

from power_estimator.effects.effect import Effect, Shape, Term
from power_estimator.effects.library import (
    bus,
    friction,
    iron_and_inverter,
    mechanics,
    sensors,
    winding,
)
from power_estimator.effects.signals.state import Signals

_NEAR = 3  # names that are offered for an unknown one
_BUILTIN = (
    mechanics.SHAFT,
    winding.COPPER_LOSS,
    winding.WINDING_HEATING,
    winding.SATURATION,
    winding.MOTOR_SATURATION,
    winding.MAGNET_HEATING,
    friction.VISCOUS_FRICTION,
    friction.COULOMB_FRICTION,
    friction.STRIBECK_FRICTION,
    friction.LOAD_FRICTION,
    iron_and_inverter.IRON_LOSS,
    iron_and_inverter.INVERTER_LOSS,
    bus.IDLE,
    bus.REGENERATION_EFFICIENCY,
    bus.REGENERATION_LIMIT,
    iron_and_inverter.FIELD_WEAKENING,
    mechanics.ROTOR_INERTIA,
    mechanics.SPRING,
    friction.COGGING,
    bus.LINE_RESISTANCE,
    sensors.POWER_GAIN,
    sensors.CURRENT_OFFSET,
    sensors.TORQUE_BIAS,
    sensors.TORQUE_BEND,
    sensors.VELOCITY_LAG,
    sensors.OFFSET_DRIFT,
    sensors.TIME_OFFSET,
)


class Catalogue(Mapping[str, Effect]):
    """Mapping of effects by name, in a fixed order; `origins` has the files of users' effects."""

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
        """Travel as the names of files: a user's effects are in no module of others."""
        files = dict.fromkeys(path.absolute() for path in self.origins.values())
        return load_catalogue, (tuple(files),)

    def get_known(self, name: str, where: str) -> Effect:
        """Return an effect by name; InputError, which begins with `where`, for an unknown one."""
        if name not in self._effects:
            known = f'known are {", ".join(self)}'
            if near := self._near(name):
                known = f'did you mean {near}? fit --effects all lists all'
            raise InputError(
                f'{where}: unknown effect {name!r}; {known} '
                '(your own go by --effects-path FILE.py)'
            )
        return self._effects[name]

    def _near(self, name: str) -> str:
        within = [one for one in self._effects if name and (one in name or name in one)]
        near = within[:_NEAR] or get_close_matches(name, self._effects, 1)
        return ' or '.join(f'{one} ({self._effects[one].physics})' for one in near)

    def physics(self) -> tuple[Effect, ...]:
        """Return the effects of the drive."""
        return tuple(effect for effect in self._effects.values() if effect.kind == 'physics')


def builtin_catalogue() -> Catalogue:
    """Return the catalogue of the shipped effects."""
    return Catalogue(_BUILTIN)


def load_catalogue(paths: Sequence[Path] = ()) -> Catalogue:
    """Return the shipped effects and those defined in the given Python files.

    The files are run: name only files that you trust. InputError if a file cannot be read or
    run, defines no effect, redefines a name, or defines one that is incomplete.
    """
    effects = list(_BUILTIN)
    origins: dict[str, Path] = {}
    for path in paths:
        for effect in _effects_in(path):
            if effect.name in {known.name for known in effects}:
                raise InputError(f'{path}: effect {effect.name!r} exists already; rename yours')
            effects.append(effect)
            origins[effect.name] = path
    return Catalogue(effects, origins)


def regressors_of(effect: Effect, signals: Signals, shape: Shape) -> Floats:
    """Return an effect's regressors [T, D, n] for n terms: W, N·m or rad/s per unit, by `acts_on`.

    They are zero where signals cannot show the effect. Raises InputError for an effect that
    raises, or returns another shape or NaN.
    """
    if signals.steady and (effect.needs_time or effect.remembers):
        return np.zeros((*signals.torque.shape, len(effect.terms)))
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
    forms = [
        value
        for value in vars(module).values()
        if (isinstance(value, Effect) and not any(value is known for known in _BUILTIN))
        or (
            inspect.isclass(value)
            and issubclass(value, Effect)
            and value.__module__ == module.__name__
        )
    ]
    if not forms:
        raise InputError(f'{path}: defines no Effect(…) and no class derived from Effect')
    return [_checked(form, path) for form in forms]


def _run(path: Path) -> ModuleType:
    source = read_text(path, 'effects')
    module = ModuleType(f'user_effects_{path.stem}')
    module.__file__ = str(path)
    try:
        exec(compile(source, str(path), 'exec'), vars(module))
    except (Exception, SystemExit) as error:  # a user's code may raise anything
        raise InputError(f'{path}: {type(error).__name__}: {error}') from error
    return module


def _checked(form: Any, path: Path) -> Effect:
    """Return an effect, or that which a class states, complete and known to come from the file."""
    is_class = inspect.isclass(form)
    where = f'{path}: ' + (f'class {form.__name__}' if is_class else f'effect {form.name!r}')
    try:
        _check_fields(form, where)
        effect: Effect = form() if is_class else form
    except InputError:
        raise
    except Exception as error:  # a user's class may hold anything
        raise InputError(f'{where}: {type(error).__name__}: {error}') from error
    return replace(effect, made=(_from_file, (path.absolute(), effect.name)))


def _check_fields(form: Any, where: str) -> None:
    for field in ('name', 'physics', 'formula', 'terms'):
        if not getattr(form, field, None):
            raise InputError(f'{where} has no {field!r}')
    if not isinstance(form.name, str) or not re.fullmatch(r'\w{1,64}', form.name):
        raise InputError(f'{where}: name is letters, digits and "_", not {quoted(form.name)}')
    if not callable(getattr(form, 'regressors', None)):
        raise InputError(f'{where} has no method regressors(self, signals, **shape)')
    for term in form.terms:
        if not isinstance(term, Term) or not term.unit or not term.lower <= term.upper:
            raise InputError(
                f'{where}: terms are Term(symbol, unit, lower, upper); got {quoted(term)}'
            )
    if form.acts_on not in ('power', 'torque', 'speed'):
        raise InputError(f"{where}: acts_on is 'power', 'torque' or 'speed', not {form.acts_on!r}")
    if form.discrepancy_limit and form.discrepancy is None:
        raise InputError(f'{where} has a discrepancy_limit but no discrepancy')


def _shipped(name: str) -> Effect:
    return builtin_catalogue()[name]


def _from_file(path: Path, name: str) -> Effect:
    return load_catalogue([path])[name]


def _travelling(effect: Effect) -> tuple[Callable[..., Effect], tuple[object, ...]]:
    """An effect travels to other processes as what makes it there, not as its functions."""
    if effect.made is None and effect not in _BUILTIN:
        raise TypeError(f'effect {effect.name!r} is in no catalogue: no other process can make it')
    return effect.made or (_shipped, (effect.name,))


copyreg.pickle(Effect, _travelling)
