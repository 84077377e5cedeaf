"""Grammar of formulas: the functions of one driver that a shape may be written as."""

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def step(z: Floats, at: float, edge: float) -> Floats:
    """0 below a place, 1 above it."""
    return 0.5 + 0.5 * np.tanh((z - at) / edge)


def window(z: Floats, low: float, high: float, edge: float) -> Floats:
    """1 in the middle between two places, half at either, 0 outside."""
    inside = np.tanh((z - low) / edge) - np.tanh((z - high) / edge)
    return 0.5 * inside / np.tanh(0.5 * (high - low) / edge)


def line(z: Floats) -> Floats:
    """The driver itself."""
    return z


def size(z: Floats) -> Floats:
    """Its magnitude."""
    return np.abs(z)


def square(z: Floats) -> Floats:
    """Its square."""
    return np.square(z)


def odd_square(z: Floats) -> Floats:
    """Its square with its sign."""
    return z * np.abs(z)


def above(z: Floats, limit: float) -> Floats:
    """What exceeds a limit."""
    return np.maximum(0.0, z - limit)


def below(z: Floats, limit: float) -> Floats:
    """What is missing to a limit."""
    return np.maximum(0.0, limit - z)


def beyond(z: Floats, limit: float) -> Floats:
    """What the magnitude exceeds a limit by."""
    return np.maximum(0.0, np.abs(z) - limit)


def beyond_square(z: Floats, limit: float) -> Floats:
    """The square of what the magnitude exceeds a limit by."""
    return np.square(np.maximum(0.0, np.abs(z) - limit))


def saturated(z: Floats, scale: float) -> Floats:
    """Proportional to a small driver, constant at a large one."""
    return np.tanh(z / scale)


def saturated_size(z: Floats, scale: float) -> Floats:
    """Proportional to a small magnitude, constant at a large one."""
    return np.tanh(np.abs(z) / scale)


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

    def grid(self, nodes: Floats, weight: Floats) -> Iterator[dict[str, float]]:
        """Parameters to be tried on nodes [K] with their shares of the samples [K]."""
        span = float(nodes[-1] - nodes[0])
        inner = nodes[1:-1]
        if self.name == 'step':
            for at in inner:
                for edge in (0.02, 0.08):
                    yield {'at': float(at), 'edge': edge * span}
        elif self.name == 'window':
            spacing = nodes[1] - nodes[0]
            for low, high in itertools.combinations(nodes, 2):
                width = high - low
                if width <= 0.75 * span:
                    for edge in (0.12, 0.45):
                        yield {
                            'low': float(low),
                            'high': float(high),
                            'edge': float(edge * max(width, spacing)),
                        }
        elif self.name in ('above', 'below'):
            for limit in inner:
                yield {'limit': float(limit)}
        elif self.name in ('beyond', 'beyond_square'):
            top = float(np.abs(nodes).max())
            for share in np.linspace(0.05, 0.9, 18):
                yield {'limit': float(share * top)}
        elif self.name in ('saturated', 'saturated_size', 'fading'):
            top = float(np.abs(nodes).max())
            for share in np.geomspace(0.02, 1.5, 16):
                yield {'scale': float(share * top)}
        elif self.name == 'wave':
            finest = 0.25 * len(nodes) * 2 * np.pi / span
            for order in np.arange(1.0, min(finest, 100.0) + 0.5, 0.5):
                if order * span > np.pi:
                    yield {'order': float(order)}
        else:
            yield {}


PRIMITIVES = {
    one.name: one
    for one in (
        Primitive('line', line, (), '{z}'),
        Primitive('size', size, (), '|{z}|'),
        Primitive('square', square, (), '{z}²'),
        Primitive('odd_square', odd_square, (), '{z}·|{z}|'),
        Primitive('above', above, ('limit',), 'max(0, {z} − {limit})'),
        Primitive('below', below, ('limit',), 'max(0, {limit} − {z})'),
        Primitive('beyond', beyond, ('limit',), 'max(0, |{z}| − {limit})'),
        Primitive('beyond_square', beyond_square, ('limit',), 'max(0, |{z}| − {limit})²'),
        Primitive('saturated', saturated, ('scale',), 'tanh({z}/{scale})'),
        Primitive('saturated_size', saturated_size, ('scale',), 'tanh(|{z}|/{scale})'),
        Primitive('fading', fading, ('scale',), 'exp(−|{z}|/{scale})'),
        Primitive('step', step, ('at', 'edge'), '[{z} > {at}]'),
        Primitive('window', window, ('low', 'high', 'edge'), '[{low} < {z} < {high}]'),
        Primitive('wave', wave, ('order',), 'sin({order}·{z} + phase)', terms=2),
    )
}
