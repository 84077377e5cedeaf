"""Conversion of units by name, with pint."""

import re
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from typing import Final

from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError, quoted

from power_recordings.importing.words import spellings

_EXAMPLES: Final = {
    'position': 'rad, deg, rev',
    'velocity': 'rad/s, deg/s, rev/s, rpm',
    'torque': 'N·m, mN·m (of a current: scale and from_unit)',
    'command': 'rad, deg, rev',
    'voltage': 'V, mV',
    'current': 'A, mA',
    'motor_current': 'A, mA',
    'power': 'W, kW',
    'loss': 'W, kW',
    'temperature': 'degC, K, degF',
    'time': 's, ms, us, ns',
}
"""Units of each quantity for messages, that of a recording first."""
SI: Final = {
    quantity: units.split(',')[0].replace('·', '*') for quantity, units in _EXAMPLES.items()
}
"""The unit of each quantity in a recording."""

_SHARES: Final = {'%': 0.01, 'percent': 0.01, 'pct': 0.01, '1': 1.0, '-': 1.0}
"""Units of an efficiency."""

# pint does not know rev. Torques are written as kgf.cm, in-lb, N·mm or ozin.
_ALIASES, _FORCES, _LEVERS = map(spellings, ('units', 'forces', 'levers'))
_FORCE, _LEVER = ('|'.join(sorted(own, key=len, reverse=True)) for own in (_FORCES, _LEVERS))
_MOMENT: Final = re.compile(
    rf'(?P<force>{_FORCE})[ .·⋅*_-]?(?P<lever>{_LEVER})'
    rf'|(?P<arm>in|inch|ft|foot)[ .·⋅*_-]?(?P<weight>{_FORCE})s?'
)
_STEP: Final = re.compile(r'[x×]?\s*(\d{1,9}(?:[.,]\d{1,9})?)\s*[x×*]?\s*(?=[^\d\s/_.,*^-])')
"""Of units such as `0.1 V`, of which a reading counts so many."""
_RATE: Final = re.compile(r'^(1|[A-Za-z]{1,8})_(?:per_)?(s|sec|min)$')
_ENERGY: Final = re.compile(r'(?i)[kmµ]?(wh|w\*?s|j|joules?|e?v\*?a?s|cal)')

# What pint is given: names, products and small powers. It computes 9**9**9, too.
_NAME = r'[A-Za-zµμΩ°_]{1,20}(\^|\*\*)?-?\d?'
_LONGEST: Final = 100  # characters
_PLAIN = re.compile(rf'(1\s*/\s*)?{_NAME}(\s*[*/· ]\s*{_NAME}){{0,4}}')


@dataclass(frozen=True)
class Conversion:
    """Conversion of a unit: converted = value · factor + offset."""

    factor: float = 1.0
    offset: float = 0.0

    def __call__(self, values: Floats) -> Floats:
        """Convert an array of any shape."""
        if self.offset:
            return values * self.factor + self.offset
        return values if self.factor == 1.0 else values * self.factor


def _spelled(unit: str) -> str:
    """A unit as pint knows it."""
    unit = _RATE.sub(r'\1/\2', unit.strip())
    if unit in _ALIASES:
        return _ALIASES[unit]
    found = _MOMENT.fullmatch('N' + unit[1:] if unit in ('nm', 'NM') else unit)
    if found is None or found[0] in ('gm', 'g m'):
        return unit
    force, lever = found['force'] or found['weight'], found['lever'] or found['arm']
    return f'{_FORCES[force]}*{_LEVERS[lever]}'


@cache
def conversion(unit: str, quantity: str) -> Conversion:
    """Return the conversion from a unit to that of a quantity in `SI`, or to 1 for efficiency.

    Raises InputError for a unit that is unknown or of another dimension.
    """
    if quantity == 'efficiency':
        if unit.strip() not in _SHARES:
            raise InputError(f'unit {quoted(unit)} is none of efficiency; expected % or 1')
        return Conversion(_SHARES[unit.strip()])
    wanted = SI[quantity]
    if (step := _STEP.match(unit.strip())) is not None:
        whole = conversion(unit.strip()[step.end() :], quantity)
        return Conversion(float(step[1].replace(',', '.')) * whole.factor, whole.offset)
    unit = _spelled(unit)
    if unit == wanted:
        return Conversion()
    import pint  # slow to import; SI does without

    registry = pint.get_application_registry()
    try:
        if len(unit) > _LONGEST or not _PLAIN.fullmatch(unit):
            raise ValueError
        if quantity == 'torque' and _ENERGY.fullmatch(unit):
            raise ValueError
        zero, one = (registry.Quantity(x, unit).to(wanted).magnitude for x in (0.0, 1.0))
        angular = 'radian' in dict(registry.get_root_units(unit)[1]._units)
    except pint.DimensionalityError:
        raise InputError(
            f'unit {quoted(unit)} is none of {quantity}; expected one such as '
            f'{_EXAMPLES[quantity]}'
        ) from None
    except Exception:  # pint raises whatever its parser of expressions does
        raise InputError(
            f'unit {quoted(unit)} of {quantity} is not known; expected one such as '
            f'{_EXAMPLES[quantity]}'
        ) from None
    if 'rad' in wanted and not angular:  # to pint a count is a radian, and 1/s is rad/s
        raise InputError(
            f'unit {quoted(unit)} of {quantity} does not say how large an angle is; expected one '
            f'such as {_EXAMPLES[quantity]}, or scale: RADIANS'
        )
    return Conversion(float(one - zero), float(zero))


def is_unit(text: str) -> bool:
    """Return whether a text names a unit of any quantity in a recording."""
    return bool(quantities_of(text))


@cache
def quantities_of(unit: str) -> tuple[str, ...]:
    """Return the quantities that a unit can belong to; empty if the unit is unknown."""
    found = []
    for quantity in (*SI, 'efficiency'):
        with suppress(InputError):
            conversion(unit, quantity)
            found.append(quantity)
    return tuple(found)
