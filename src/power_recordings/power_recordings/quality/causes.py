"""Units other than those of an import map, and the slopes that they make."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np

from power_recordings.card import Card

_TURN: Final = 2 * np.pi
UNITS: Final[Mapping[str, Mapping[str, float]]] = {
    'velocity': {'rad/s': 1.0, 'rev/s': _TURN, 'rpm': _TURN / 60, 'deg/s': _TURN / 360},
    'position': {'rad': 1.0, 'rev': _TURN, 'deg': _TURN / 360},
    'time': {'s': 1.0, 'ms': 1e-3, 'us': 1e-6},
    'torque': {'N*m': 1.0, 'mN*m': 1e-3},
    'current': {'A': 1.0, 'mA': 1e-3},
    'voltage': {'V': 1.0, 'mV': 1e-3},
    'power': {'W': 1.0, 'kW': 1e3, 'mW': 1e-3},
}
"""Units that quantities may be in, and their sizes in that of a recording, which is the first."""
_SPOKEN: Final = {
    'rev/s': 'turns per second',
    'rev': 'turns',
    'deg/s': 'degrees per second',
    'deg': 'degrees',
    'us': 'µs',
}
TOLERANCE: Final = 0.12  # of a slope, from which units that make it may differ
_WIDE: Final = 2.0  # times by which losses may take a slope off that of torque or current
_CHOSEN: Final = 0.03  # of a slope, for a unit other than that of a recording
_LOSSY: Final = (('torque',), ('current',), ('voltage',), ('power',))
_METER: Final = ('current', 'voltage', 'power')  # whose units differ by thousands and no less

# Quantities that are wrong alone or together, each with its exponent in a slope.
Causes = Sequence[Mapping[str, int]]
OF_VELOCITY: Final[Causes] = (
    {'velocity': -1},
    {'position': 1},
    {'time': -1},
    {'position': 1, 'velocity': -1},
)
OF_TORQUE: Final[Causes] = ({'torque': 1},)
OF_METER: Final[Mapping[str, Causes]] = {
    'current': ({'current': -1}, {'voltage': -1}),
    'power': ({'power': -1},),
    '': (),
}
"""By what the power is known by."""
OF_POWER: Final[Mapping[str, Causes]] = {
    'current': (
        *OF_METER['current'],
        {'velocity': 1},
        *OF_TORQUE,
        {'velocity': 1, 'torque': 1},
        {'current': -1, 'voltage': -1},
    ),
    'power': ({'velocity': 1}, *OF_TORQUE, *OF_METER['power'], {'velocity': 1, 'torque': 1}),
    '': ({'velocity': 1}, *OF_TORQUE, {'velocity': 1, 'torque': 1}),
}
"""By what the power is known by."""


@dataclass(frozen=True)
class Cause:
    """Units that quantities are in, in place of those of the map; of none, it is false.

    others: units that would make the same slope.
    """

    units: Mapping[str, str]
    others: tuple[Mapping[str, str], ...] = ()

    def __bool__(self) -> bool:
        return bool(self.units)

    def __str__(self) -> str:
        names = {'velocity': 'speed', 'time': 'the time', 'position': 'the position'}

        def told(quantity: str, unit: str) -> str:
            spoken = _SPOKEN.get(unit, unit).replace('*', '·')
            return f'{names.get(quantity, quantity)} is in {spoken}'

        alike = (self.units, *self.others)
        return ' or '.join(' and '.join(told(*one) for one in each.items()) for each in alike)

    @property
    def mend(self) -> str:
        """The entries of a map that state these units; '' where others do as well."""
        entries = (f'{quantity}: {{unit: {unit}}}' for quantity, unit in self.units.items())
        return '' if self.others else ', '.join(entries)

    def with_position(self, card: Card, drive: str) -> 'Cause':
        """Return the cause with the position's unit beside that of a speed that is its rate.

        The position is then as wrong as the speed; where no unit of it is, other causes are left.
        An import that has no column for the speed states the position's unit alone.
        """
        speed = self.units.get('velocity')
        if speed is None:
            return self
        stated = {
            q: card.unit_of(drive, q) or next(iter(UNITS[q])) for q in ('velocity', 'position')
        }
        off = UNITS['velocity'][speed] / UNITS['velocity'].get(stated['velocity'], np.nan)
        for unit, size in UNITS['position'].items():
            if np.isclose(size / UNITS['position'].get(stated['position'], np.nan), off):
                of_rate = drive in card.derived_velocity
                both = {'position': unit} | ({} if of_rate else dict(self.units))
                return Cause(both, self.others)
        return Cause(self.others[0], self.others[1:]) if self.others else Cause({})


def cause_of(slope: float, causes: Causes, card: Card, drive: str) -> Cause:
    """Return the units that make a slope, where 1 is right, of what it is; none if none do.

    They differ from those that the map states, and rather from the usual ones, which a guess may
    have put there; those of a meter are as likely. drive: '' for all.
    """
    best, nearest = Cause({}), np.inf
    for exponents in causes:
        for units in product(*(UNITS[quantity] for quantity in exponents)):
            factor, chosen = 1.0, 0.0
            for (quantity, exponent), unit in zip(exponents.items(), units, strict=True):
                usual = next(iter(UNITS[quantity]))
                stated = card.unit_of(drive, quantity) or usual
                chosen += _CHOSEN * (stated != usual and quantity not in _METER)
                seen = stated == usual and tuple(exponents) == ('voltage',)  # by its size alone
                known = stated != unit and not seen
                size = UNITS[quantity].get(stated, np.nan) if known else np.nan
                factor *= (UNITS[quantity][unit] / size) ** exponent
            off = abs(np.log(max(slope, 1e-12) / factor))
            limit = np.log(_WIDE if tuple(exponents) in _LOSSY else 1 + TOLERANCE)
            own = dict(zip(exponents, units, strict=True))
            if off < limit and off + chosen < nearest - 1e-9:
                best, nearest = Cause(own), off + chosen
            elif off < limit and off + chosen < nearest + 1e-9:
                best = Cause(best.units, (*best.others, own))
    return best


def common_name(quantity: str, size: float) -> str:
    """Return the name in `UNITS` of a unit of a quantity by its size; `other` if it has none."""
    known = UNITS.get(quantity, {}).items()
    return next((name for name, own in known if np.isclose(own, size, rtol=1e-9)), 'other')
