"""Anchoring of a policy to a reference policy where robots are out of balance.

A few hundred robots fall too seldom for PPO to learn from it what keeps a robot up: it trades
that for a little less torque while nothing disturbs it. So PPO improves the gait in balance; out
of balance the policy is pulled back to its reference, the policy before PPO, which was hard to
push over.
"""

import copy
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import torch
from policy_runner.policies.blended_network import Perceptron
from policy_runner.policies.gait_phase import capture_point_error, urgency
from policy_runner.policies.observations import Observation
from torch import nn
from wattwalk_core.arrays import Bools, Floats

from policy_training.config import TrainingConfig
from policy_training.environment.environment import WalkingEnvironment
from policy_training.evaluation.task_trial import TaskTrial, TrialScore

_BATCHES: Final = 4


class ReferencePolicy:
    """Reference of a network (observations [n, size] → actions [n, 12]): the network as it is now.

    Rows count in proportion to the urgency that `observation.cadence_adaptation` gives for the
    true state, from a least one on; gait phases themselves go by the sensors. tolerance: of the
    actions' error, in their own units. rate: learning rate.
    """

    def __init__(
        self,
        actor: nn.Module,
        observation: Observation,
        *,
        tolerance: float,
        rate: float,
        least_urgency: float = 0.0,
    ) -> None:
        self.actor = actor
        self._reference = copy.deepcopy(actor).requires_grad_(False)
        self._optimiser = torch.optim.Adam(actor.parameters(), lr=rate)
        self._observation = observation
        self._tolerance = tolerance
        self._least_urgency = least_urgency

    def anchor(self, observations: torch.Tensor, states: torch.Tensor) -> tuple[float, float]:
        """Pull the network back on observations [n, size] out of balance.

        states: the same without noise [n, size or more]. Returns the share of rows that count,
        and the weighted RMS error of their actions before this.
        """
        weight = torch.from_numpy(self._urgency(states)).float().to(observations.device)
        chosen = (weight > 0.0) & (weight >= self._least_urgency)
        rows, weight = observations[chosen], weight[chosen, None]
        if not len(rows):
            return 0.0, 0.0
        with torch.no_grad():
            wanted = self._reference(rows)
            squares = weight * (self.actor(rows) - wanted).square()
            error = float((squares.mean() / weight.mean()).sqrt())
        size = -(-len(rows) // _BATCHES)
        for part in torch.randperm(len(rows), device=rows.device).split(size):
            away = (self.actor(rows[part]) - wanted[part]).abs()
            loss = (weight[part] * (away - self._tolerance).clamp_min(0.0).square()).mean()
            if not loss.item():
                continue  # or the optimiser's momentum would go on
            self._optimiser.zero_grad()
            loss.backward()
            self._optimiser.step()
        return float(chosen.float().mean()), error

    def content(self) -> dict[str, Any]:
        """Return tensors and numbers for `restore`."""
        return {'network': self._reference.state_dict(), 'optimiser': self._optimiser.state_dict()}

    def restore(self, content: dict[str, Any], *, go_on: bool) -> None:
        """Take the reference of another run or, to go on, that of this one's checkpoint."""
        self._reference.load_state_dict(content['network'])
        if go_on:
            rates = [group['lr'] for group in self._optimiser.param_groups]
            self._optimiser.load_state_dict(content['optimiser'])
            for group, rate in zip(self._optimiser.param_groups, rates, strict=True):
                group['lr'] = rate

    def _urgency(self, states: torch.Tensor) -> Any:
        """Share of the cadence adaptation, 0..1 [n]."""
        seen = self._observation
        values = states[:, : seen.size].cpu().numpy() / seen.scales()

        def plane(name: str) -> Any:
            start = seen.part(name).start
            return values[:, start : start + 2]

        error = capture_point_error(plane('command') - plane('base_velocity'), plane('gravity'))
        return urgency(seen.cadence_adaptation, error)


class NetworkWalker:
    """A network that acts without exploration on all robots of an environment."""

    def __init__(self, network: Perceptron, environment: WalkingEnvironment) -> None:
        self._network = network
        self._environment = environment

    def actions(self) -> Floats:
        """Return the actions of the next step [N, 12]."""
        return np.asarray(self._network(self._environment.observe()), np.float64)

    def reset(self, done: Bools) -> None:
        """Do nothing: the network has no state."""


class PolicyTrial:
    """The trial of a training's `selection`."""

    def __init__(self, config: TrainingConfig, observation: Observation) -> None:
        self._trial = TaskTrial(
            config.selection.trial,
            threads=config.physics.threads,
            observation=observation,
            action_scale=config.action_scale,
            plant=config.physics.plant,
        )

    def run(self, layers: Sequence[tuple[torch.Tensor, torch.Tensor]], seed: int) -> TrialScore:
        """Return the score of a policy by weight [out, in] and bias [out] of its layers."""
        tensors = {}
        for index, (weight, bias) in enumerate(layers):
            tensors[f'layer{index}.weight'] = weight.numpy()
            tensors[f'layer{index}.bias'] = bias.numpy()
        network = Perceptron(tensors, 'elu')
        return self._trial.run(lambda robots: NetworkWalker(network, robots), seed)
