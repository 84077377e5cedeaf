"""Trials of a policy in training on the tasks."""

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from policy_runner.policies.observations import Observation
from policy_runner.policies.perceptron import Perceptron

from policy_training.config import TrainingConfig
from policy_training.environment.environment import WalkingEnvironment
from policy_training.evaluation.task_trial import TaskTrial, TrialScore

Floats = NDArray[np.float64]


class NetworkWalker:
    """A network that acts without exploration on all robots of an environment."""

    def __init__(self, network: Perceptron, environment: WalkingEnvironment) -> None:
        self._network = network
        self._environment = environment

    def actions(self) -> Floats:
        """Return the actions of the next step [N, 12]."""
        return np.asarray(self._network(self._environment.observe()), np.float64)

    def reset(self, done: NDArray[np.bool_]) -> None:
        """Do nothing: the network has no state."""


class PolicyTrial:
    """The trial of a training's `selection`."""

    def __init__(self, config: TrainingConfig, observation: Observation) -> None:
        self._trial = TaskTrial(
            config.selection.trial,
            threads=config.physics.threads,
            observation=observation,
            action_scale=config.action_scale,
        )

    def run(self, layers: Sequence[tuple[torch.Tensor, torch.Tensor]], seed: int) -> TrialScore:
        """Return the score of a policy by weight [out, in] and bias [out] of its layers."""
        tensors = {}
        for index, (weight, bias) in enumerate(layers):
            tensors[f'layer{index}.weight'] = weight.numpy()
            tensors[f'layer{index}.bias'] = bias.numpy()
        network = Perceptron(tensors, 'elu')
        return self._trial.run(lambda robots: NetworkWalker(network, robots), seed)[0]
