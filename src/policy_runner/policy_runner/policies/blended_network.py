"""
Networks of a policy folder, one or a blend of two.

What saves power in balance costs falls out of it: a narrow stance and low feet. So a policy may
bring a fallback, a second network that is hard to push over: it acts out of balance, under
commands that mix axes and when the robot is to stand.
"""

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from policy_runner.policies.folder import FALLBACK, Contract, Fallback
from policy_runner.policies.gait_phase import DEAD_ZONE, capture_point_error
from policy_runner.policies.observations import Observation
from policy_runner.policies.perceptron import Perceptron

Floats = NDArray[np.float32]
Network = Callable[[Floats], Floats]
"""Observations [..., size] to actions [..., 12]."""


def network_of(contract: Contract, tensors: Mapping[str, Floats]) -> Network:
    """Return the network of a policy folder, with its fallback if it has one."""
    kind = contract.network.activation
    first = Perceptron({k: v for k, v in tensors.items() if not k.startswith(FALLBACK)}, kind)
    if contract.network.fallback is None:
        return first
    second = {k.removeprefix(FALLBACK): v for k, v in tensors.items() if k.startswith(FALLBACK)}
    share = FallbackShare(contract.network.fallback, contract.observation)
    return BlendedNetwork(first, Perceptron(second, kind), share)


class FallbackShare:
    """Share of the fallback by what the policy observes, see `folder.Fallback`."""

    def __init__(self, config: Fallback, observation: Observation) -> None:
        self._config = config
        self._largest = np.array(config.largest)
        scales = observation.scales()
        self._parts = {
            name: (observation.part(name), scales[observation.part(name)])
            for name in ('base_velocity', 'gravity', 'command')
        }

    def __call__(self, observation: Floats) -> Floats:
        """Return the share of observations [..., size], 0..1 [...]."""
        config = self._config
        velocity, gravity, command = (
            observation[..., part].astype(np.float64) / scale
            for part, scale in self._parts.values()
        )
        error = capture_point_error(velocity[..., :2] - command[..., :2], gravity[..., :2])
        axes = np.sort(np.abs(command) / self._largest, axis=-1)
        ratio = axes[..., 1] / np.maximum(axes[..., 2], DEAD_ZONE)
        share = np.maximum(
            _ramp(error, config.onset, config.full), _ramp(ratio, config.one_axis, config.mixed)
        )
        standing = np.linalg.norm(command, axis=-1) < DEAD_ZONE
        return np.asarray(np.where(standing, 1.0, share), np.float32)


class BlendedNetwork:
    """Two networks, blended by a share of the second."""

    def __init__(self, first: Perceptron, second: Perceptron, share: FallbackShare) -> None:
        self._first = first
        self._second = second
        self.share = share

    def __call__(self, observation: Floats) -> Floats:
        """Return actions [..., 12] for observations [..., size]."""
        share = self.share(observation)[..., None]
        first, second = self._first(observation), self._second(observation)
        return np.asarray(first + share * (second - first))


def _ramp(values: NDArray[np.float64], low: float, high: float) -> NDArray[np.float64]:
    return np.clip((values - low) / (high - low), 0.0, 1.0)
