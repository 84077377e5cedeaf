"""Model files: YAML of active effects with fitted coefficients, checked on reading."""

from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import numpy as np
from wattwalk_core.errors import InputError, quoted
from wattwalk_core.files import write_whole
from wattwalk_core.schema import Length, Name, Printable, Quantity, parse, schema
from wattwalk_core.yaml_file import dump_yaml, read_yaml

from power_estimator.drive_types import DriveType
from power_estimator.effects import Catalogue, Effect, Term
from power_estimator.effects.fit.design import Active, Prior, Structure
from power_estimator.effects.fit.whole_robot import COMMON
from power_estimator.effects.model_file.model import (
    NOMINAL_VOLTAGE,
    DriveGroup,
    EffectModel,
    FittedValue,
    by_term,
)
from power_estimator.effects.signals.scale import REFERENCE, DriveScale

FORMAT: Final = 'power_model/1'
_SLACK = 1e-5  # of a value that is written with six digits
_FACTORS = tuple(field.name for field in fields(DriveScale))
_Number = Annotated[float, Quantity(-1e12, 1e12)]
_Factor = Annotated[float, Quantity(1e-9, 1e9)]


@schema
class _ValueContent:
    value: _Number
    interval: tuple[_Number, _Number] | None = None
    symbol: Annotated[str, Printable(0)] = ''
    unit: str | None = None
    at_bound: Literal['', 'lower', 'upper'] = ''

    def __post_init__(self) -> None:
        if self.interval is not None and self.interval[0] > self.interval[1]:
            low, high = self.interval
            raise InputError(f'interval {low:g} … {high:g} runs backwards')


@schema
class _GroupContent:
    coefficients: dict[str, tuple[_ValueContent, ...]]
    patterns: Annotated[tuple[Name, ...], Length(1)] | None = None
    measurement: dict[str, _ValueContent] | None = None
    velocity_lag: Annotated[float, Quantity(0.0, 1.0, 's')] = 0.0
    voltage: Annotated[float, Quantity(0.1, 1e4, 'V')] = NOMINAL_VOLTAGE
    copper: Annotated[float, Quantity(0.0, 1e6, 'W/(N·m)²')] = 0.0
    base_factor: _Number | None = None
    scale: dict[str, _Factor] | None = None
    torque_constant: _Factor | None = None


@schema
class _ModelContent:
    effects: dict[str, dict[str, Annotated[float, Quantity(-1e9, 1e9)]] | None]
    format: Literal['power_model/1'] = FORMAT
    name: Name | None = None
    base: Name | None = None
    metered: Literal['drives', 'robot'] = 'drives'
    drives: dict[str, _GroupContent] | None = None
    fitted_on: tuple[dict[str, Name], ...] | None = None
    history: tuple[dict[str, Any], ...] | None = None
    prior: dict[str, tuple[tuple[_Number, _Number] | None, ...]] | None = None

    def __post_init__(self) -> None:
        if not self.effects:
            raise InputError('effects lists none; name what is active')
        for entry in self.history or ():
            for key in ('added', 'effects', 'rmse_w', 'rmse_before_w'):
                kind = dict[str, _Number] if key.startswith('rmse') else tuple[Name, ...]
                if entry.get(key) is not None:
                    parse(kind, entry[key], f'history: {key}')


def write_model(model: EffectModel, path: Path) -> None:
    """Write a model file, whole or not at all; RecordingError if it cannot be written."""
    content = {
        'format': FORMAT,
        'name': model.name,
        'base': model.base or None,
        'metered': None if model.metered == 'drives' else model.metered,
        'effects': {a.name: dict(a.parameters) or None for a in model.structure.actives},
        'drives': {
            group.type.name: _rounded(_group_content(group, model.structure))
            for group in model.groups
        }
        or None,
        'prior': {
            name: _rounded([own if np.isfinite(own[1]) else None for own in each])
            for name, each in model.prior.items()
        }
        or None,
        'fitted_on': [dict(entry) for entry in model.fitted_on] or None,
        'history': [dict(entry) for entry in model.history] or None,
    }
    known = {key: value for key, value in content.items() if value is not None}
    write_whole(path, dump_yaml(known))


def _group_content(group: DriveGroup, structure: Structure) -> dict[str, Any]:
    factors = dict(zip(_FACTORS, group.scale, strict=True))
    return {
        'patterns': group.type.patterns,
        # Below 0 the estimate of a lag is noise, or it is the position that comes late.
        'velocity_lag': max(group.velocity_lag, 0.0),
        'voltage': group.voltage,
        'copper': group.copper or None,
        'base_factor': group.base_factor,
        'scale': None if group.scale == REFERENCE else factors,
        'torque_constant': group.torque_constant,
        'coefficients': {
            active.name: [
                {'symbol': term.symbol, 'unit': term.unit, **_value_content(value)}
                for term, value in by_term(active, group)
            ]
            for active in structure.free
        },
        'measurement': {n: _value_content(v) for n, v in group.measurement.items()} or None,
    }


def _value_content(own: FittedValue) -> dict[str, Any]:
    return {'value': own.value, 'interval': own.interval, 'at_bound': own.at_bound or None}


def _rounded(content: Any) -> Any:
    """Content with numbers of six digits, and without entries that are None."""
    if isinstance(content, dict):
        return {key: _rounded(own) for key, own in content.items() if own is not None}
    if isinstance(content, list | tuple):
        return [_rounded(own) for own in content]
    if content is None or isinstance(content, str):
        return content
    return float(f'{content:.6g}')  # also of a NumPy number, which YAML would not know


def read_model(path: Path, catalogue: Catalogue) -> EffectModel:
    """Read a model file; InputError names the entry that is wrong and says why.

    catalogue: the effects that the file may name. A base model is not loaded.
    """
    where = f'model {path}'
    content = parse(_ModelContent, _in_full(read_yaml(path, 'model'), where), where)
    structure = _structure(content, catalogue, where)
    return EffectModel(
        name=content.name or path.stem,
        structure=structure,
        groups=_groups(content, structure, catalogue, where),
        base=content.base,
        metered=content.metered,
        fitted_on=content.fitted_on or (),
        history=content.history or (),
        prior=_prior(content, catalogue, where),
    )


def _prior(content: _ModelContent, catalogue: Catalogue, where: str) -> Prior:
    prior = {}
    for name, own in (content.prior or {}).items():
        if len(own) != len(catalogue.get_known(name, where).terms):
            raise InputError(f'{where}: prior of {name} has {len(own)} values')
        prior[name] = tuple(one or (0.0, np.inf) for one in own)
    return prior


def _in_full(content: Any, where: str) -> Any:
    """Write short forms out: effects as a list, values as numbers alone."""
    if not isinstance(content, dict):
        return content
    effects = content.get('effects')
    if isinstance(effects, list):
        for name in effects:
            if not isinstance(name, str):
                raise InputError(f'{where}: effects lists names, there is {quoted(name)}')
        content['effects'] = dict.fromkeys(effects)
    drives = content.get('drives')
    for group in drives.values() if isinstance(drives, dict) else ():
        for key in ('coefficients', 'measurement') if isinstance(group, dict) else ():
            if isinstance(group.get(key), dict):
                group[key] = {name: _value_in_full(given) for name, given in group[key].items()}
    return content


def _value_in_full(given: Any) -> Any:
    if isinstance(given, list):
        return [_value_in_full(each) for each in given]
    return {'value': given} if isinstance(given, int | float) else given


def _structure(content: _ModelContent, catalogue: Catalogue, where: str) -> Structure:
    actives = []
    for name, shape in content.effects.items():
        effect = catalogue.get_known(name, where)
        default = dict(effect.shapes[0])
        for key in shape or {}:
            if key not in default:
                known = ', '.join(default) or 'none'
                raise InputError(f'{where}: {name!r} has no shape {quoted(key)}; known: {known}')
        if effect.kind == 'physics':
            actives.append(Active.of(effect, {**default, **(shape or {})}))
    return Structure(tuple(actives))


def _groups(
    content: _ModelContent, structure: Structure, catalogue: Catalogue, where: str
) -> tuple[DriveGroup, ...]:
    drives = content.drives or {}
    scales = [_scale(group, f'{where}: {name}') for name, group in drives.items()]
    whole = DriveScale.stack(scales).whole() if drives and content.metered == 'robot' else None
    return tuple(
        _group(name, group, structure, catalogue, f'{where}: {name}', whole)
        for name, group in drives.items()
    )


def _scale(content: _GroupContent, where: str) -> tuple[float, ...]:
    if content.scale is None:
        return REFERENCE
    if set(content.scale) != set(_FACTORS):
        raise InputError(
            f'{where}: scale must give {", ".join(_FACTORS)}, not {quoted(content.scale)}'
        )
    return tuple(content.scale[factor] for factor in _FACTORS)


def _group(
    name: str,
    content: _GroupContent,
    structure: Structure,
    catalogue: Catalogue,
    where: str,
    whole: DriveScale | None,
) -> DriveGroup:
    given, active = content.coefficients, {entry.name for entry in structure.free}
    for term in given:
        catalogue.get_known(term, where)
        if term not in active:
            raise InputError(f'{where}: coefficients of {term!r}, which is not active')
    factors = _scale(content, where)
    scale = DriveScale.stack([factors])
    coefficients = {}
    for entry in structure.free:
        if entry.name not in given:
            raise InputError(f'{where}: has no coefficients of {entry.name!r}; fit the model')
        size = whole if whole and entry.name in COMMON else scale
        coefficients[entry.name] = _values(entry.effect, given[entry.name], size, where)
    measurement = {}
    for term, value in (content.measurement or {}).items():
        effect = catalogue.get_known(term, where)
        if effect.kind != 'measurement':
            raise InputError(f'{where}: measurement has {term!r}, which is none of its errors')
        measurement[term] = _values(effect, (value,), whole or scale, where)[0]
    return DriveGroup(
        type=DriveType(name, content.patterns or (f'*_{name}', name)),
        coefficients=coefficients,
        measurement=measurement,
        velocity_lag=content.velocity_lag,
        voltage=content.voltage,
        copper=content.copper,
        base_factor=content.base_factor,
        scale=factors,
        torque_constant=content.torque_constant,
    )


def _values(
    effect: Effect, given: Sequence[_ValueContent], scale: DriveScale, where: str
) -> tuple[FittedValue, ...]:
    count = len(effect.terms)
    if len(given) != count:
        raise InputError(
            f'{where}: {effect.name} has {count} coefficient{"s" if count > 1 else ""}, there '
            f'are {len(given)}'
        )
    return tuple(
        _value(value, term, factor, f'{where}: {effect.name} {term.symbol}')
        for value, term, factor in zip(
            given, effect.terms, effect.factors(scale)[0].tolist(), strict=True
        )
    )


def _value(given: _ValueContent, term: Term, factor: float, where: str) -> FittedValue:
    value, lower, upper = given.value, term.lower * factor, term.upper * factor
    if given.unit not in (None, term.unit, term.formerly):
        raise InputError(f'{where} is given in {quoted(given.unit)}; it must be in {term.unit!r}')
    slack = _SLACK * abs(value)
    if not lower - slack <= value <= upper + slack:
        raise InputError(f'{where} = {value:g}: physics allows {lower:g} … {upper:g} {term.unit}')
    return FittedValue(value, given.interval or (value, value), given.at_bound)
