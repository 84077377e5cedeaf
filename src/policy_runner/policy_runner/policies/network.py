"""Network of a policy folder."""

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np
from wattwalk_core.arrays import Singles


def _elu(x: Singles) -> Singles:
    return np.where(x > 0, x, np.expm1(np.minimum(x, 0)))


def _relu(x: Singles) -> Singles:
    return np.maximum(x, 0)


def _tanh(x: Singles) -> Singles:
    return np.tanh(x)


_FUNCTIONS: Final[Mapping[str, Callable[[Singles], Singles]]] = {
    'elu': _elu,
    'relu': _relu,
    'tanh': _tanh,
}


class Perceptron:
    """Perceptron of the layers `layer0`, `layer1`, … of a policy folder; the last is linear."""

    def __init__(self, tensors: Mapping[str, Singles], activation: str) -> None:
        count = sum(name.endswith('.weight') for name in tensors)
        self._layers = [
            (np.ascontiguousarray(tensors[f'layer{i}.weight'].T), tensors[f'layer{i}.bias'])
            for i in range(count)
        ]
        self._activate = _FUNCTIONS[activation]

    def __call__(self, observation: Singles) -> Singles:
        """Return actions [..., outputs] for observations [..., inputs]."""
        x = observation
        for weight, bias in self._layers[:-1]:
            x = self._activate(x @ weight + bias)
        weight, bias = self._layers[-1]
        return np.asarray(x @ weight + bias)


Network = Callable[[Singles], Singles]  # observations [..., size] to actions [..., 12]
