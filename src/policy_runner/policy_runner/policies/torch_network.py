"""Networks of a policy folder as torch modules that TorchScript takes."""

from collections.abc import Mapping
from typing import Final

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from policy_runner.policies.folder import FALLBACK, Contract, Fallback
from policy_runner.policies.gait_phase import DEAD_ZONE, TILT_SPEED
from policy_runner.policies.observations import Observation

_ACTIVATIONS: Final = {'elu': nn.ELU, 'relu': nn.ReLU, 'tanh': nn.Tanh}


def torch_network(contract: Contract, tensors: Mapping[str, NDArray[np.float32]]) -> nn.Module:
    """Return the network of a policy folder, [N, size] → [N, 12], with its fallback if any."""
    network = _perceptron(contract, tensors, '')
    if contract.network.fallback is not None:
        second = _perceptron(contract, tensors, FALLBACK)
        network = _BlendedModule(network, second, contract.network.fallback, contract.observation)
    return network.requires_grad_(False)


def _perceptron(
    contract: Contract, tensors: Mapping[str, NDArray[np.float32]], prefix: str
) -> nn.Module:
    layers: list[nn.Module] = []
    for index in range(len(contract.network.hidden) + 1):
        weight, bias = (
            torch.from_numpy(tensors[f'{prefix}layer{index}.{part}'])
            for part in ('weight', 'bias')
        )
        linear = nn.Linear(weight.shape[1], weight.shape[0])
        linear.load_state_dict({'weight': weight, 'bias': bias})
        layers += [linear, _ACTIVATIONS[contract.network.activation]()]
    return nn.Sequential(*layers[:-1])


class _BlendedModule(nn.Module):
    """The arithmetic of `blended_network.BlendedNetwork`."""

    scales: torch.Tensor
    largest: torch.Tensor

    def __init__(
        self, first: nn.Module, second: nn.Module, fallback: Fallback, observation: Observation
    ) -> None:
        super().__init__()
        self.first = first
        self.second = second
        self.velocity_at = observation.part('base_velocity').start
        self.gravity_at = observation.part('gravity').start
        self.command_at = observation.part('command').start
        self.onset, self.full = fallback.onset, fallback.full
        self.one_axis, self.mixed = fallback.one_axis, fallback.mixed
        self.tilt_speed, self.dead_zone = TILT_SPEED, DEAD_ZONE
        scales = torch.from_numpy(observation.scales()).float()
        self.register_buffer('scales', scales)
        self.register_buffer('largest', torch.tensor(fallback.largest, dtype=torch.float32))

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Return actions [N, 12] for observations [N, size]."""
        values = observation / self.scales
        velocity = values[:, self.velocity_at : self.velocity_at + 2]
        tilt = values[:, self.gravity_at : self.gravity_at + 2]
        command = values[:, self.command_at : self.command_at + 3]
        away = (velocity - command[:, :2]).square().sum(1)
        error = (away + (self.tilt_speed * tilt).square().sum(1)).sqrt()
        axes = torch.sort(command.abs() / self.largest, dim=1)[0]
        ratio = axes[:, 1] / axes[:, 2].clamp_min(self.dead_zone)
        lost = ((error - self.onset) / (self.full - self.onset)).clamp(0.0, 1.0)
        mixed = ((ratio - self.one_axis) / (self.mixed - self.one_axis)).clamp(0.0, 1.0)
        share = torch.maximum(lost, mixed)
        standing = command.square().sum(1).sqrt() < self.dead_zone
        share = torch.where(standing, torch.ones_like(share), share)[:, None]
        first = self.first(observation)
        return first + share * (self.second(observation) - first)
