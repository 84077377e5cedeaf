"""Multi-layer perceptron in numpy, without start-up time and threads."""

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]


def _elu(x: Floats) -> Floats:
    return np.where(x > 0, x, np.expm1(np.minimum(x, 0)))


def _relu(x: Floats) -> Floats:
    return np.maximum(x, 0)


def _tanh(x: Floats) -> Floats:
    return np.tanh(x)


_FUNCTIONS: Final[Mapping[str, Callable[[Floats], Floats]]] = {
    'elu': _elu,
    'relu': _relu,
    'tanh': _tanh,
}


class Perceptron:
    """Perceptron of the layers `layer0`, `layer1`, … of a policy folder; the last is linear."""

    def __init__(self, tensors: Mapping[str, Floats], activation: str) -> None:
        count = sum(name.endswith('.weight') for name in tensors)
        self._layers = [
            (np.ascontiguousarray(tensors[f'layer{i}.weight'].T), tensors[f'layer{i}.bias'])
            for i in range(count)
        ]
        self._activate = _FUNCTIONS[activation]

    def __call__(self, observation: Floats) -> Floats:
        """Return actions [..., outputs] for observations [..., inputs]."""
        x = observation
        for weight, bias in self._layers[:-1]:
            x = self._activate(x @ weight + bias)
        weight, bias = self._layers[-1]
        return np.asarray(x @ weight + bias)
