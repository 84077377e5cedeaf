"""Conversion of units by name, with pint."""

import re
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Final

from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError, quoted

if TYPE_CHECKING:
    from pint import UnitRegistry  # slow to import

SI: Final = {
    'position': 'rad',
    'velocity': 'rad/s',
    'torque': 'N*m',
    'command': 'rad',
    'voltage': 'V',
    'current': 'A',
    'motor_current': 'A',
    'power': 'W',
    'temperature': 'degC',
    'time': 's',
}
"""The unit of each quantity in a recording."""

# Points and blanks as people write them. pint reads Nm as a textile number and does not know rev.
_ALIASES: Final = {
    **{name: 'turn' for name in ('rev', 'revs', 'revolution', 'revolutions', 'turns', 'r')},
    **{name: 'turn/s' for name in ('rps', 'rev/s', 'turns/s', 'r/s', 'Hz')},
    **{name: 'rad/s' for name in ('rad/sec', 'rad.s', 'rad s-1', 'rad·s⁻¹')},
    **{
        name: 'rpm'
        for name in ('RPM', 'Rpm', 'rev/min', 'r/min', '1/min', 'U/min', 'min-1', 'min^-1')
    },
    **{name: 'N*m' for name in ('Nm', 'nm', 'NM', 'N m', 'N·m', 'N.m', 'N-m', 'newton_meter')},
    **{name: 'mN*m' for name in ('mNm', 'mN·m')},
    **{name: 'lbf*inch' for name in ('in-lb', 'in-lbs', 'lb-in', 'in-lbf', 'lbf-in', 'in lb')},
    **{name: 'lbf*foot' for name in ('ft-lb', 'ft-lbs', 'lb-ft', 'ft-lbf', 'lbf-ft', 'ft lb')},
    **{name: 'ozf*inch' for name in ('oz-in', 'in-oz', 'ozf-in', 'oz in')},
    **{name: 'kN*m' for name in ('kNm', 'kN·m')},
    **{name: 'N*cm' for name in ('Ncm', 'N·cm')},
    **{name: 'N*mm' for name in ('Nmm', 'N·mm', 'N.mm', 'N-mm')},
    **{
        name: 'degC'
        for name in (
            '°C',
            '℃',
            'C',
            'celsius',
            'Celsius',
            'deg_C',
            'deg C',
            'Deg C',
            'degree_celsius',
        )
    },
    **{name: 'degF' for name in ('°F', 'F')},
    **{name: 'deg' for name in ('°', 'degrees')},
    **{name: 'deg/s' for name in ('°/s', 'dps', 'degrees/s')},
    **{name: 's' for name in ('sec', 'secs', 'seconds')},
    'µs': 'us',
    'μs': 'us',
    'usec': 'us',
    'msec': 'ms',
    'nsec': 'ns',
}

# What pint is given: names, products and small powers. It computes 9**9**9, too.
_NAME = r'[A-Za-zµμΩ°_]{1,20}(\^|\*\*)?-?\d?'
_PLAIN = re.compile(rf'(1\s*/\s*)?{_NAME}(\s*[*/· ]\s*{_NAME}){{0,4}}')


@dataclass(frozen=True)
class Conversion:
    """value · factor + offset."""

    factor: float = 1.0
    offset: float = 0.0

    def __call__(self, values: Floats) -> Floats:
        """Convert an array of any shape."""
        if self.offset:
            return values * self.factor + self.offset
        return values if self.factor == 1.0 else values * self.factor


@cache
def conversion(unit: str, quantity: str) -> Conversion:
    """
    Return the conversion from a unit to that of a quantity in a recording (`SI`).

    Raises InputError for a unit that is unknown or of another dimension.
    """
    wanted = SI[quantity]
    unit = _ALIASES.get(unit.strip(), unit.strip())
    if unit == wanted:
        return Conversion()
    import pint  # slow to import; SI does without

    registry = _registry()
    try:
        if not _PLAIN.fullmatch(unit):
            raise ValueError
        zero, one = (registry.Quantity(x, unit).to(wanted).magnitude for x in (0.0, 1.0))
    except pint.DimensionalityError:
        raise InputError(
            f'unit {quoted(unit)} is none of {quantity}; expected one such as '
            f'{_examples(quantity)}'
        ) from None
    except Exception:  # pint raises whatever its parser of expressions does
        raise InputError(
            f'unit {quoted(unit)} of {quantity} is not known; expected one such as '
            f'{_examples(quantity)}'
        ) from None
    return Conversion(float(one - zero), float(zero))


def is_unit(text: str) -> bool:
    """Return whether a text names a unit of any quantity in a recording."""
    return bool(quantities_of(text))


@cache
def quantities_of(unit: str) -> tuple[str, ...]:
    """Return the quantities that a unit can belong to."""
    known = _ALIASES.get(unit.strip(), unit.strip())
    if not _PLAIN.fullmatch(known):
        return ()
    try:
        _registry().parse_units(known)
    except Exception:  # pint raises whatever its parser of expressions does
        return ()
    found = []
    for quantity in SI:
        try:
            conversion(unit, quantity)
        except InputError:
            continue
        found.append(quantity)
    return tuple(found)


@cache
def _registry() -> 'UnitRegistry':
    from pint import UnitRegistry  # slow to import

    return UnitRegistry()


def _examples(quantity: str) -> str:
    return {
        'position': 'rad, deg, rev',
        'command': 'rad, deg, rev',
        'velocity': 'rad/s, deg/s, rev/s, rpm',
        'torque': 'N·m, mN·m (of a current: scale and from_unit)',
        'voltage': 'V, mV',
        'current': 'A, mA',
        'motor_current': 'A, mA',
        'power': 'W, kW',
        'temperature': 'degC, K, degF',
        'time': 's, ms, us, ns',
    }[quantity]
