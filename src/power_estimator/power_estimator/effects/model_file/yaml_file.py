"""Model files: YAML of active effects with fitted coefficients, checked on reading."""

import math
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import yaml
from wattwalk_core.errors import InputError
from wattwalk_core.files import write_whole

from power_estimator.drive_types import DriveType
from power_estimator.effects import Catalogue, Effect, Term
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.effects.model_file.model import (
    NOMINAL_VOLTAGE,
    DriveGroup,
    EffectModel,
    FittedValue,
)
from power_estimator.effects.signals.scale import REFERENCE, DriveScale

FORMAT = 'power_model/1'
_KEYS = {'format', 'name', 'base', 'effects', 'drives', 'fitted_on', 'history'}
_SLACK = 1e-5  # of a value that is written with six digits
_FACTORS = tuple(field.name for field in fields(DriveScale))


def write_model(model: EffectModel, path: Path) -> None:
    """Write whole or not at all."""
    content: dict[str, Any] = {'format': FORMAT, 'name': model.name}
    if model.base:
        content['base'] = model.base
    content['effects'] = {
        active.name: dict(active.parameters) or None for active in model.structure.actives
    }
    if model.groups:
        content['drives'] = {
            group.type.name: _group_content(group, model.structure) for group in model.groups
        }
    if model.fitted_on:
        content['fitted_on'] = [dict(entry) for entry in model.fitted_on]
    if model.history:
        content['history'] = [dict(entry) for entry in model.history]
    text = yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=98)
    write_whole(path, text)


def _group_content(group: DriveGroup, structure: Structure) -> dict[str, Any]:
    content: dict[str, Any] = {
        'patterns': list(group.type.patterns),
        'velocity_lag': _number_out(group.velocity_lag),
        'voltage': _number_out(group.voltage),
    }
    if group.copper:
        content['copper'] = _number_out(group.copper)
    if group.scale != REFERENCE:
        content['scale'] = dict(zip(_FACTORS, map(_number_out, group.scale), strict=True))
    if group.torque_constant is not None:
        content['torque_constant'] = _number_out(group.torque_constant)
    content['coefficients'] = {
        active.name: [
            {'symbol': term.symbol, 'unit': term.unit, **_value_content(value)}
            for term, value in zip(
                active.effect.terms, group.coefficients[active.name], strict=True
            )
        ]
        for active in structure.free
    }
    if group.measurement:
        content['measurement'] = {
            name: _value_content(value) for name, value in group.measurement.items()
        }
    return content


def _value_content(value: FittedValue) -> dict[str, Any]:
    return {
        'value': _number_out(value.value),
        'interval': [_number_out(bound) for bound in value.interval],
        **({'at_bound': value.at_bound} if value.at_bound else {}),
    }


def _number_out(value: float) -> float:
    return float(f'{value:.6g}')


def read_model(path: Path, catalogue: Catalogue) -> EffectModel:
    """Read and check; InputError says which entry is wrong and why."""
    content = _content(path)
    where = str(path)
    unknown = set(content) - _KEYS
    if unknown:
        raise InputError(f'{where}: unknown entry {sorted(unknown)[0]!r}')
    if content.get('format', FORMAT) != FORMAT:
        raise InputError(f'{where}: format is {content["format"]!r}; this reads {FORMAT!r}')
    structure = _structure(content.get('effects'), catalogue, where)
    name = content.get('name', path.stem)
    base = content.get('base')
    if not isinstance(name, str) or not (base is None or isinstance(base, str)):
        raise InputError(f'{where}: name and base must be text, not {name!r} and {base!r}')
    return EffectModel(
        name=name,
        structure=structure,
        groups=_groups(content.get('drives'), structure, catalogue, where),
        base=base,
        fitted_on=tuple(_entries(content, 'fitted_on', where)),
        history=tuple(_entries(content, 'history', where)),
    )


def _content(path: Path) -> Mapping[str, Any]:
    try:
        content = yaml.safe_load(path.read_text(encoding='utf-8'))
    except OSError as error:
        raise InputError(f'{path}: cannot be read ({error.strerror})') from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InputError(f'{path}: not YAML ({str(error).splitlines()[0]})') from error
    if not isinstance(content, Mapping):
        raise InputError(f'{path}: not a power model; it needs an entry effects')
    return content


def _structure(effects: object, catalogue: Catalogue, where: str) -> Structure:
    if isinstance(effects, list):
        effects = dict.fromkeys(effects)
    if not isinstance(effects, Mapping) or not effects:
        raise InputError(f'{where}: effects must list what is active, not {effects!r}')
    actives = []
    for name, shape in effects.items():
        effect = catalogue.get_known(str(name), where)
        if effect.kind != 'physics':
            continue
        actives.append(Active.of(effect, _shape(effect, shape, where)))
    return Structure(tuple(actives))


def _shape(effect: Effect, shape: object, where: str) -> dict[str, float]:
    default = dict(effect.shapes[0])
    if shape is None:
        return default
    if not isinstance(shape, Mapping):
        raise InputError(f'{where}: shape of {effect.name!r} must be a mapping, not {shape!r}')
    for key, value in shape.items():
        if key not in default:
            known = ', '.join(default) or 'none'
            raise InputError(f'{where}: {effect.name!r} has no shape {key!r}; known: {known}')
        default[str(key)] = _finite(value, f'{where}: {effect.name} {key}')
    return default


def _groups(
    drives: object, structure: Structure, catalogue: Catalogue, where: str
) -> tuple[DriveGroup, ...]:
    if drives is None:
        return ()
    if not isinstance(drives, Mapping):
        raise InputError(f'{where}: drives must map drive types to coefficients, not {drives!r}')
    groups = []
    for name, content in drives.items():
        if not isinstance(content, Mapping):
            raise InputError(f'{where}: drives {name!r} must be a mapping, not {content!r}')
        groups.append(_group(str(name), content, structure, catalogue, f'{where}: {name}'))
    return tuple(groups)


def _group(
    name: str, content: Mapping[str, Any], structure: Structure, catalogue: Catalogue, where: str
) -> DriveGroup:
    patterns = content.get('patterns', [f'*_{name}', name])
    if not isinstance(patterns, list) or not all(isinstance(p, str) for p in patterns):
        raise InputError(f'{where}: patterns must be a list of names, not {patterns!r}')
    given = content.get('coefficients')
    if not isinstance(given, Mapping):
        raise InputError(f'{where}: has no coefficients')
    active = {entry.name for entry in structure.free}
    for effect in given:
        catalogue.get_known(str(effect), where)
        if effect not in active:
            raise InputError(f'{where}: coefficients of {effect!r}, which is not active')
    factors = _scale(content.get('scale'), where)
    scale = DriveScale.stack([factors])
    constant = content.get('torque_constant')
    coefficients = {}
    for entry in structure.free:
        if entry.name not in given:
            raise InputError(f'{where}: has no coefficients of {entry.name!r}; fit the model')
        coefficients[entry.name] = _values(entry.effect, given[entry.name], scale, where)
    measurement = content.get('measurement') or {}
    if not isinstance(measurement, Mapping):
        raise InputError(f'{where}: measurement must be a mapping, not {measurement!r}')
    checked = {}
    for term, value in measurement.items():
        catalogue.get_known(str(term), where)
        checked[str(term)] = _values(catalogue[str(term)], [value], scale, where)[0]
    return DriveGroup(
        type=DriveType(name, tuple(patterns)),
        coefficients=coefficients,
        measurement=checked,
        velocity_lag=_finite(content.get('velocity_lag', 0.0), f'{where}: velocity_lag'),
        voltage=_finite(content.get('voltage', NOMINAL_VOLTAGE), f'{where}: voltage'),
        copper=_finite(content.get('copper', 0.0), f'{where}: copper'),
        scale=factors,
        torque_constant=None
        if constant is None
        else _finite(constant, f'{where}: torque_constant'),
    )


def _scale(given: object, where: str) -> tuple[float, ...]:
    if given is None:
        return REFERENCE
    if not isinstance(given, Mapping) or set(given) != set(_FACTORS):
        raise InputError(f'{where}: scale must give {", ".join(_FACTORS)}, not {given!r}')
    factors = tuple(_finite(given[name], f'{where}: scale {name}') for name in _FACTORS)
    if min(factors) <= 0.0:
        raise InputError(f'{where}: scale = {min(factors):g}; factors are above 0')
    return factors


def _values(
    effect: Effect, given: object, scale: DriveScale, where: str
) -> tuple[FittedValue, ...]:
    count = len(effect.terms)
    if not isinstance(given, list) or len(given) != count:
        raise InputError(
            f'{where}: {effect.name} has {count} coefficient{"s" if count > 1 else ""}, '
            f'not {given!r}'
        )
    return tuple(
        _value(value, term, factor, f'{where}: {effect.name} {term.symbol}')
        for value, term, factor in zip(
            given, effect.terms, effect.factors(scale)[0].tolist(), strict=True
        )
    )


def _value(given: object, term: Term, factor: float, where: str) -> FittedValue:
    if not isinstance(given, Mapping):
        given = {'value': given}
    unit = given.get('unit', term.unit)
    if unit != term.unit:
        raise InputError(f'{where} is given in {unit!r}; it must be in {term.unit!r}')
    value = _finite(given.get('value'), where)
    lower, upper = term.lower * factor, term.upper * factor
    slack = _SLACK * abs(value)
    if not lower - slack <= value <= upper + slack:
        raise InputError(f'{where} = {value:g}: physics allows {lower:g} … {upper:g} {term.unit}')
    interval = given.get('interval', [value, value])
    if not isinstance(interval, list) or len(interval) != 2:
        raise InputError(f'{where}: interval must be two numbers, not {interval!r}')
    low, high = (_finite(bound, f'{where} interval') for bound in interval)
    if low > high:
        raise InputError(f'{where}: interval {low:g} … {high:g} runs backwards')
    at_bound = given.get('at_bound', '')
    if at_bound not in ('', 'lower', 'upper'):
        raise InputError(f'{where}: at_bound is lower or upper, not {at_bound!r}')
    return FittedValue(value, (low, high), at_bound)


def _finite(value: object, where: str) -> float:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not number or not math.isfinite(value):  # type: ignore[arg-type]
        raise InputError(f'{where} = {value!r} is not a number')
    return float(value)  # type: ignore[arg-type]


def _entries(content: Mapping[str, Any], key: str, where: str) -> list[Mapping[str, Any]]:
    entries = content.get(key) or []
    if not isinstance(entries, list) or not all(isinstance(e, Mapping) for e in entries):
        raise InputError(f'{where}: {key} must be a list of mappings')
    return entries
