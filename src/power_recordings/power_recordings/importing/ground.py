"""Motion along the ground or a rail, which a radius makes the turning of a shaft."""

import re
from collections.abc import Mapping, Sequence
from typing import Final

from power_recordings.importing.listing import Listed
from power_recordings.importing.sources.heads import unit_of
from power_recordings.importing.units import quantities_of
from power_recordings.importing.words import WANTED, words, yaml_text

_SPEED: Final = re.compile(
    r'(?<![a-z])(?:(?P<road>km[/_]?h|kph|mph|mps)|(?P<length>mm|cm|m)[/_](?P<time>s|min))[\])]?$'
)
"""Units of a speed that is none of a shaft, in lower case, as the others."""
_LENGTH: Final = re.compile(r'(?<![a-z])(?P<length>[mck]m|(?<=[\[(])m(?=[\])]))[\])]?$')
_METRES: Final = re.compile(r'_(?P<length>m)$')  # or of a motor
_SIZES: Final = {'mm': 1e-3, 'cm': 1e-2, 'm': 1.0, 'km': 1e3, 's': 1.0, 'min': 60.0}
_ROADS: Final = {'mph': 0.44704, 'mps': 1.0}
_RUNS: Final = r'speed|vel|tempo|geschw'
_WAYS: Final = (
    r'(^|_)(dist\w*|way|weg|strecke|travel\w*|odo\w*|path|height|stroke|lift|pos\w*|[xyz])(_|$)'
)
_LINE: Final = (
    '    # {}: {{from: {}, scale: {:.4g}, unit: {}}}   # along the ground or a rail: scale over '
    'the radius of wheel or pulley in m; of a screw, over its lead / 2π'
)


def is_along(address: str) -> bool:
    """Return whether a column's unit is of a way or a speed that is none of a shaft."""
    return bool(_unit(_SPEED, address) or _unit(_LENGTH, address))


def along_lines(listed: Sequence[Listed]) -> Mapping[str, str]:
    """Return a line of a map for the first speed and the first way along the ground, if any.

    One tells the other by a common name, as in `car_mm` and `car_mm_s`.
    """
    moving = [item.column.address for item in listed if item.changes > 0]
    moving = [name for name in moving if not re.search(WANTED, words(name))]
    speeds = {name: m for name in moving if (m := _unit(_SPEED, name))}
    ways = {name: m for name in moving if (m := _unit(_LENGTH, name) or _unit(_METRES, name))}
    kinds = (('velocity', 'rad/s', _RUNS, speeds, ways), ('position', 'rad', _WAYS, ways, speeds))
    lines = {}
    for quantity, unit, rule, own, others in kinds:
        known = {_stem(name, found) for name, found in others.items()}
        for name, found in own.items():
            if quantity not in lines and (
                re.search(rule, words(name)) or _stem(name, found) in known
            ):
                lines[quantity] = _LINE.format(quantity, yaml_text(name), _size(found), unit)
    return lines


def _unit(pattern: re.Pattern[str], address: str) -> re.Match[str] | None:
    """Return the unit that ends a name; None for a part of a torque's, as in kgf cm."""
    found = pattern.search(address.lower())
    return found if found and 'torque' not in quantities_of(unit_of(address)) else None


def _stem(name: str, found: re.Match[str]) -> str:
    return name[: found.start()].rstrip('_ [(/.')


def _size(found: re.Match[str]) -> float:
    """Size of a unit in m or m/s."""
    parts = found.groupdict()
    if road := parts.get('road'):
        return _ROADS.get(road, 1 / 3.6)
    return _SIZES[parts['length']] / _SIZES[parts.get('time') or 's']
