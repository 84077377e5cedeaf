"""
Networks of a policy folder, one or a blend of two.

What saves power in balance costs falls out of it: a narrow stance and low feet. So a policy may
bring a fallback, a second network that is hard to push over: it acts out of balance, under
commands that mix axes and when the robot is to stand.
"""

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from policy_runner.policies.folder import FALLBACK, SEEN_BY_FALLBACK, Contract, Fallback
from policy_runner.policies.gait_phase import DEAD_ZONE, capture_point_error, ramp
from policy_runner.policies.observations import Observation
from policy_runner.policies.perceptron import Perceptron

Floats = NDArray[np.float32]
Network = Callable[[Floats], Floats]
"""Observations [..., size] to actions [..., 12]."""


def network_of(contract: Contract, tensors: Mapping[str, Floats]) -> Network:
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

    def __call__(self, observation: Floats) -> Floats:
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

    def __call__(self, observation: Floats) -> Floats:
        """Return actions [..., 12] for observations [..., size]."""
        share = self.share(observation)[..., None]
        first, second = self._first(observation), self._second(observation)
        return np.asarray(first + share * (second - first))
