"""Networks of a policy folder, one or a blend of two.

What saves power in balance costs falls out of it: a narrow stance and low feet. So a policy may
bring a fallback, a second network that is hard to push over: it acts out of balance, under
commands that mix axes and when the robot is to stand.
"""

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np
from wattwalk_core.arrays import Singles

from policy_runner.policies.folder import FALLBACK, SEEN_BY_FALLBACK, Contract, Fallback
from policy_runner.policies.gait_phase import DEAD_ZONE, capture_point_error, ramp
from policy_runner.policies.observations import Observation


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


def network_of(contract: Contract, tensors: Mapping[str, Singles]) -> Network:
    """Return the network of a policy folder, with its fallback if it has one."""

    def part(prefix: str) -> Perceptron:
        start = f'{prefix}layer'
        named = {k.removeprefix(prefix): v for k, v in tensors.items() if k.startswith(start)}
        return Perceptron(named, contract.network.activation)

    if contract.network.fallback is None:
        return part('')
    share = FallbackShare(contract.network.fallback, contract.observation)
    return BlendedNetwork(part(''), part(FALLBACK), share)


class FallbackShare:
    """Share of the fallback by what the policy observes, see `folder.Fallback`."""

    def __init__(self, config: Fallback, observation: Observation) -> None:
        self._config = config
        self._largest = np.array(config.largest)
        scales = observation.scales()
        parts = [observation.part(name) for name in SEEN_BY_FALLBACK]
        self._parts = [(part, scales[part]) for part in parts]

    def __call__(self, observation: Singles) -> Singles:
        """Return the share of observations [..., size], 0..1 [...]."""
        config = self._config
        velocity, gravity, command = (
            observation[..., part].astype(np.float64) / scale for part, scale in self._parts
        )
        error = capture_point_error(velocity[..., :2] - command[..., :2], gravity[..., :2])
        axes = np.sort(np.abs(command) / self._largest, axis=-1)
        ratio = axes[..., 1] / np.maximum(axes[..., 2], DEAD_ZONE)
        share = np.maximum(
            ramp(error, config.onset, config.full), ramp(ratio, config.one_axis, config.mixed)
        )
        standing = np.linalg.norm(command, axis=-1) < DEAD_ZONE
        return np.asarray(np.where(standing, 1.0, share), np.float32)


class BlendedNetwork:
    """Two networks, blended by a share of the second."""

    def __init__(self, first: Perceptron, second: Perceptron, share: FallbackShare) -> None:
        self._first = first
        self._second = second
        self.share = share

    def __call__(self, observation: Singles) -> Singles:
        """Return actions [..., 12] for observations [..., size]."""
        share = self.share(observation)[..., None]
        first, second = self._first(observation), self._second(observation)
        return np.asarray(first + share * (second - first))
