"""A formula over drives: one primitive of one family with parameters for each drive."""

import itertools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from power_estimator.effects.fit.design_builder import Linearisation
from power_estimator.effects.signals.prepared import Prepared
from scipy.optimize import minimize
from wattwalk_core.arrays import Floats

from power_lab.structure.drivers import Family
from power_lab.structure.shapes import DriveProblem, instant


def step(z: Floats, at: float, edge: float) -> Floats:
    """Smooth step of z: 0 below `at`, 1 above, within about ± edge."""
    return 0.5 + 0.5 * np.tanh((z - at) / edge)


def window(z: Floats, low: float, high: float, edge: float) -> Floats:
    """Smooth window of z: 1 between low and high, half at either, 0 outside, within about edge."""
    inside = np.tanh((z - low) / edge) - np.tanh((z - high) / edge)
    return 0.5 * inside / np.tanh(0.5 * (high - low) / edge)


def turn_window(z: Floats, middle: float, half: float, edge: float) -> Floats:
    """Smooth periodic window of an angle z in rad: 1 around middle, 0.5 at ± half, 0 beyond."""
    away = np.abs(np.mod(z - middle + np.pi, 2.0 * np.pi) - np.pi)
    inside = np.tanh((half - away) / edge) + np.tanh((half + away) / edge)
    return 0.5 * inside / np.tanh(half / edge)


def line(z: Floats) -> Floats:
    """Return z."""
    return z


def square(z: Floats) -> Floats:
    """Square of z."""
    return np.square(z)


def odd_square(z: Floats) -> Floats:
    """Square of z with the sign of z."""
    return z * np.abs(z)


def above(z: Floats, limit: float) -> Floats:
    """Excess of z over a limit, 0 below it."""
    return np.maximum(0.0, z - limit)


def below(z: Floats, limit: float) -> Floats:
    """Shortfall of z to a limit, 0 above it."""
    return np.maximum(0.0, limit - z)


def above_square(z: Floats, limit: float) -> Floats:
    """Square of the excess of z over a limit."""
    return np.square(np.maximum(0.0, z - limit))


def saturated(z: Floats, scale: float) -> Floats:
    """Saturation: z/scale for small z, ±1 for large z."""
    return np.tanh(z / scale)


def fading(z: Floats, scale: float) -> Floats:
    """Decay with the magnitude of z: 1 at zero, 1/e at scale."""
    return np.exp(-np.abs(z) / scale)


def wave(z: Floats, order: float) -> Floats:
    """Sine and cosine of order·z [..., 2]."""
    return np.stack([np.sin(order * z), np.cos(order * z)], axis=-1)


@dataclass(frozen=True)
class Primitive:
    """Elementwise function that a formula may be made of, such as a step or a wave."""

    name: str
    of: Callable[..., Floats]
    parameters: tuple[str, ...]
    text: str  # with {z} and the parameters
    terms: int = 1

    @property
    def complexity(self) -> int:
        """Number of parameters and coefficients to fit."""
        return len(self.parameters) + self.terms

    def columns(self, z: Floats, values: dict[str, float]) -> Floats:
        """Return the regressors [..., terms] of z [...] with these parameters."""
        found = self.of(z, **values)
        return found if self.terms > 1 else found[..., None]

    def on(self, nodes: Floats) -> tuple[list[dict[str, float]], Floats]:
        """Return n parameter sets to try on evenly spaced nodes [K], and columns [n, K, terms]."""
        if self.name in ('step', 'window'):
            span = float(nodes[-1] - nodes[0])
            unit, columns = _on_unit(self.name, len(nodes))
            moved = [
                {k: v * span + (0.0 if k == 'edge' else float(nodes[0])) for k, v in one.items()}
                for one in unit
            ]
            return moved, columns
        grid = list(self._grid(nodes))
        if not grid:
            return grid, np.empty((0, len(nodes), self.terms))
        return grid, np.stack([self.columns(nodes, values) for values in grid])

    def _grid(self, nodes: Floats) -> Iterator[dict[str, float]]:
        span = float(nodes[-1] - nodes[0])
        top = float(np.abs(nodes).max())
        match self.parameters:
            case ('at', 'edge'):
                for at, edge in itertools.product(nodes[1:-1], (0.02, 0.08)):
                    yield {'at': float(at), 'edge': edge * span}
            case ('low', 'high', 'edge'):
                for low, high in itertools.combinations(nodes.tolist(), 2):
                    if high - low <= _WIDEST * span:
                        for edge in (0.12, 0.45):
                            yield {'low': low, 'high': high, 'edge': edge * (high - low)}
            case ('middle', 'half', 'edge'):
                if abs(span - 2.0 * np.pi) < _NEARLY_A_TURN:
                    for middle, half in itertools.product(nodes, np.geomspace(0.04, 1.6, 16)):
                        for edge in (0.24, 0.9):
                            yield {'middle': float(middle), 'half': half, 'edge': edge * half}
            case ('limit',):
                for limit in nodes[1:-1].tolist():
                    yield {'limit': limit}
            case ('scale',):
                for share in np.geomspace(0.02, 1.5, 16):
                    yield {'scale': float(share * top)}
            case ('order',):
                finest = 0.25 * len(nodes) * 2 * np.pi / span
                for order in np.arange(1.0, min(finest, 100.0) + 0.5, 0.5):
                    if order * span > np.pi:
                        yield {'order': float(order)}
            case _:
                yield {}


_NEARLY_A_TURN = 0.1  # rad
_WIDEST = 0.75  # share of the driver's range that a window may fill


@lru_cache(maxsize=8)
def _on_unit(name: str, count: int) -> tuple[list[dict[str, float]], Floats]:
    """Grid and columns on nodes from 0 to 1, which all drivers share."""
    primitive, nodes = PRIMITIVES[name], np.linspace(0.0, 1.0, count)
    grid = list(primitive._grid(nodes))
    return grid, np.stack([primitive.columns(nodes, values) for values in grid])


PRIMITIVES = {
    one.name: one
    for one in (
        Primitive('line', line, (), '{z}'),
        Primitive('square', square, (), '{z}²'),
        Primitive('odd_square', odd_square, (), '{z}·|{z}|'),
        Primitive('above', above, ('limit',), 'max(0, {z} − {limit})'),
        Primitive('below', below, ('limit',), 'max(0, {limit} − {z})'),
        Primitive('above_square', above_square, ('limit',), 'max(0, {z} − {limit})²'),
        Primitive('saturated', saturated, ('scale',), 'tanh({z}/{scale})'),
        Primitive('fading', fading, ('scale',), 'exp(−|{z}|/{scale})'),
        Primitive('step', step, ('at', 'edge'), '[{z} > {at}]'),
        Primitive('window', window, ('low', 'high', 'edge'), '[{low} < {z} < {high}]'),
        Primitive(
            'turn_window',
            turn_window,
            ('middle', 'half', 'edge'),
            '[{middle} − {half} < {z} < {middle} + {half}]',
        ),
        Primitive('wave', wave, ('order',), 'sin({order}·{z} + phase)', terms=2),
    )
}


_EVALUATIONS = 60
_OF_DRIVER = ('line', 'above', 'below')
_OF_SQUARE = ('square', 'odd_square', 'above_square')


@dataclass(frozen=True)
class Place:
    """Parameters and gain of a formula on one drive."""

    family: Family
    parameters: Mapping[str, float]
    gain: float  # W² by row, held out


@dataclass(frozen=True)
class Formula:
    """Formula of a discovered effect: a function of a driver, with its parameters by drive."""

    primitive: Primitive
    places: Mapping[int, Place]  # by drive

    @property
    def family(self) -> Family:
        """Driver, factor and side (torque or power) of the drive where it gains most."""
        return max(self.places.values(), key=lambda place: place.gain).family

    @property
    def gain(self) -> float:
        """Held-out gain summed over its drives, W²."""
        return sum(place.gain for place in self.places.values())

    @property
    def kind(self) -> str:
        """Kind of quantity that it depends on, such as `position`."""
        return self.family.kind

    def text(self, drive: int | None = None) -> str:
        """Formula as text: with the parameters of a drive, or in general where none is given."""
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
        parts = []
        unit = family.driver.unit
        if unit and self.primitive.name in (*_OF_DRIVER, *_OF_SQUARE):
            plain = unit if '·' not in unit and '/' not in unit else f'({unit})'
            parts.append(plain + ('²' if self.primitive.name in _OF_SQUARE else ''))
        of_factor = family.factor.unit
        if of_factor:
            parts.append(f'({of_factor})' if '/' in of_factor else of_factor)
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
    """Refine a formula's parameters on one drive by a fit to all samples; the gain is kept."""
    if not primitive.parameters:
        return place
    z, weight = instant(place.family, point, problem.drive)
    names = primitive.parameters
    start = np.array([place.parameters[name] for name in names])
    low, high = np.quantile(z, (0.001, 0.999))
    span = float(high - low)
    if primitive.name == 'window':
        own_span = place.parameters['high'] - place.parameters['low']
    elif primitive.name == 'turn_window':
        own_span = 2.0 * place.parameters['half']
    else:
        own_span = span
    steps = np.full(len(start), 0.1 * own_span)
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
    """Wrap `middle`, if given, to −π … π rad in place; return the parameters."""
    if 'middle' in given:
        given['middle'] = float(np.mod(given['middle'] + np.pi, 2.0 * np.pi) - np.pi)
    return given
