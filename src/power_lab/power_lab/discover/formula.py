"""A formula over drives: one primitive of one family with parameters for each drive."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from power_estimator.effects.fit.design_builder import Linearisation
from power_estimator.effects.signals.prepared import Prepared
from scipy.optimize import minimize
from wattwalk_core.arrays import Floats

from power_lab.discover.grammar import Primitive
from power_lab.structure.drivers import Family
from power_lab.structure.problem import DriveProblem
from power_lab.structure.shapes import instant

_EVALUATIONS = 60
_OF_DRIVER = ('line', 'above', 'below')
_OF_SQUARE = ('square', 'odd_square', 'above_square')


@dataclass(frozen=True)
class Place:
    """The formula on one drive."""

    family: Family
    parameters: Mapping[str, float]
    gain: float  # W² by row, held out


@dataclass(frozen=True)
class Formula:
    """One primitive of one family, with its parameters by drive."""

    primitive: Primitive
    places: Mapping[int, Place]  # by drive
    shape_gain: float  # W² summed over its drives, of the free shapes

    @property
    def family(self) -> Family:
        """Family of the drive where it gains most."""
        return max(self.places.values(), key=lambda place: place.gain).family

    @property
    def gain(self) -> float:
        """W² summed over its drives."""
        return sum(place.gain for place in self.places.values())

    @property
    def kind(self) -> str:
        """Quantity that it depends on."""
        return self.family.kind

    def text(self, drive: int | None = None) -> str:
        """Formula in words and numbers, of a drive or in general."""
        place = None if drive is None else self.places[drive]
        family = self.family if place is None else place.family
        symbol = family.driver.symbol
        if drive is None and family.driver.other:
            symbol = symbol.partition(' ')[0] + ' of another drive'
        words = {
            name: name if place is None else f'{place.parameters[name]:.3g}'
            for name in self.primitive.parameters
        }
        core = self.primitive.text.format(z=symbol, **words).replace('− -', '+ ')
        factor = family.factor.symbol
        left = 'motor torque' if family.acts_on == 'torque' else 'P'
        amplitude = 'A' if self.primitive.terms > 1 else 'c'
        return f'{left} = {amplitude}·{core}' + (f'·{factor}' if factor else '')

    @property
    def unit(self) -> str:
        """Unit of its coefficients."""
        family = self.family
        power = 1 if self.primitive.name in _OF_DRIVER else 0
        power = 2 if self.primitive.name in _OF_SQUARE else power
        parts = []
        if power and family.driver.unit:
            unit = family.driver.unit
            plain = unit if '·' not in unit and '/' not in unit else f'({unit})'
            parts.append(plain + ('²' if power == 2 else ''))
        if family.factor.unit:
            unit = family.factor.unit
            parts.append(f'({unit})' if '/' in unit else unit)
        base = 'N·m' if family.acts_on == 'torque' else 'W'
        if parts == [base]:
            return '1'
        below = '·'.join(parts)
        if not below:
            return base
        return f'{base}/{below}' if len(parts) == 1 and '·' not in below else f'{base}/({below})'


def refined(
    problem: DriveProblem,
    primitive: Primitive,
    place: Place,
    point: Linearisation,
    prepared: Prepared,
) -> Place:
    """Parameters that fit best with exact columns, from those found on the shape's nodes."""
    if not primitive.parameters:
        return place
    z, weight = instant(place.family, point, problem.drive)
    names = primitive.parameters
    start = np.array([place.parameters[name] for name in names])
    low, high = np.quantile(z, (0.001, 0.999))
    span = float(high - low)
    given = place.parameters
    if primitive.name == 'window':
        span_of = given['high'] - given['low']
    elif primitive.name == 'turn_window':
        span_of = 2.0 * given['half']
    else:
        span_of = span
    steps = np.full(len(start), 0.1 * span_of)
    if names[0] in ('scale', 'order'):
        steps = 0.15 * start if names[0] == 'scale' else np.array([0.3])
    if names[-1] == 'edge':
        steps[-1] = 0.3 * start[-1]

    def error(values: Floats) -> float:
        given = dict(zip(names, values.tolist(), strict=True))
        if given.get('edge', 1.0) < 1e-3 * span or given.get('scale', 1.0) <= 1e-3 * span:
            return np.inf
        if 'low' in given and not low - span < given['low'] < given['high'] < high + span:
            return np.inf
        if 'low' in given and given['edge'] > 0.6 * (given['high'] - given['low']):
            return np.inf
        if 'half' in given and not 0.0 < given['edge'] < 1.2 * given['half'] < 6.0:
            return np.inf
        column = primitive.columns(z, given) * weight[:, None]
        moments = problem.moments(prepared.reduced(column))
        solved = problem.solve(moments, np.zeros((primitive.terms, primitive.terms)))[-1]
        gram, moment = moments.gram[-1], moments.moment[-1]
        return float(solved @ (gram @ solved - 2.0 * moment))

    simplex = np.vstack([start, start + np.diag(steps)])
    found = minimize(
        error,
        start,
        method='Nelder-Mead',
        options={'initial_simplex': simplex, 'maxfev': _EVALUATIONS, 'xatol': 1e-4, 'fatol': 1e-3},
    )
    best = start if not np.isfinite(found.fun) else found.x
    own = principal(dict(zip(names, best.tolist(), strict=True)))
    return Place(place.family, own, place.gain)


def principal(given: dict[str, float]) -> dict[str, float]:
    """Return the same parameters, with a place in the turn between −π and π."""
    if 'middle' in given:
        given['middle'] = float(np.mod(given['middle'] + np.pi, 2.0 * np.pi) - np.pi)
    return given
