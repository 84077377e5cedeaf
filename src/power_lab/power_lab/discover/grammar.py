"""Grammar of formulas: the functions of one driver that a shape may be written as."""

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from wattwalk_core.arrays import Floats


def step(z: Floats, at: float, edge: float) -> Floats:
    """0 below a place, 1 above it."""
    return 0.5 + 0.5 * np.tanh((z - at) / edge)


def window(z: Floats, low: float, high: float, edge: float) -> Floats:
    """1 in the middle between two places, half at either, 0 outside."""
    inside = np.tanh((z - low) / edge) - np.tanh((z - high) / edge)
    return 0.5 * inside / np.tanh(0.5 * (high - low) / edge)


def turn_window(z: Floats, middle: float, half: float, edge: float) -> Floats:
    """1 around a place in the turn, half at a distance from it, 0 elsewhere."""
    away = np.abs(np.mod(z - middle + np.pi, 2.0 * np.pi) - np.pi)
    inside = np.tanh((half - away) / edge) + np.tanh((half + away) / edge)
    return 0.5 * inside / np.tanh(half / edge)


def line(z: Floats) -> Floats:
    """The driver itself."""
    return z


def square(z: Floats) -> Floats:
    """Its square."""
    return np.square(z)


def odd_square(z: Floats) -> Floats:
    """Its square with its sign."""
    return z * np.abs(z)


def above(z: Floats, limit: float) -> Floats:
    """Excess over a limit."""
    return np.maximum(0.0, z - limit)


def below(z: Floats, limit: float) -> Floats:
    """Shortfall to a limit."""
    return np.maximum(0.0, limit - z)


def above_square(z: Floats, limit: float) -> Floats:
    """The square of what exceeds a limit."""
    return np.square(np.maximum(0.0, z - limit))


def saturated(z: Floats, scale: float) -> Floats:
    """Proportional to a small driver, constant at a large one."""
    return np.tanh(z / scale)


def fading(z: Floats, scale: float) -> Floats:
    """1 at zero, less the larger the magnitude."""
    return np.exp(-np.abs(z) / scale)


def wave(z: Floats, order: float) -> Floats:
    """Sine and cosine of the driver times an order [..., 2]."""
    return np.stack([np.sin(order * z), np.cos(order * z)], axis=-1)


@dataclass(frozen=True)
class Primitive:
    """One function of the grammar."""

    name: str
    of: Callable[..., Floats]
    parameters: tuple[str, ...]
    text: str  # with {z} and the parameters
    terms: int = 1

    @property
    def complexity(self) -> int:
        """Numbers to be found."""
        return len(self.parameters) + self.terms

    def columns(self, z: Floats, values: dict[str, float]) -> Floats:
        """Return [..., terms]."""
        found = self.of(z, **values)
        return found if self.terms > 1 else found[..., None]

    def on(self, nodes: Floats) -> tuple[list[dict[str, float]], Floats]:
        """Parameters to be tried on evenly spaced nodes [K], and the columns [n, K, terms]."""
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
