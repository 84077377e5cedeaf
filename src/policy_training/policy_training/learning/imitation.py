"""Imitation of an expert policy, a scripted trot, before PPO.

From random networks, PPO with a few hundred robots stands still for millions of steps: feet that
chatter cost more than they gain. So the policy first learns the trot's actions for its own
observations, also along its own way (DAgger, Ross et al. 2011): a share of each action is its own
while the trot gives the labels, since a copy of the trot's way alone does not hold.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import torch
from torch import nn
from wattwalk_core.arrays import Singles

from policy_training.config import TrainingConfig
from policy_training.environment.environment import WalkingEnvironment
from policy_training.environment.expert_policy import RAMP, ExpertPolicy
from policy_training.environment.vec_env import Mirror
from policy_training.learning.gait_files import load_gait, load_gait_table

_FIRST_SHARES: Final = (0.0, 0.4)  # of the policy in the action, by round
_SHARE: Final = 0.7  # of it in further rounds
_ACTION_NOISE: Final = 0.15  # standard deviation, for every other robot
_RATE: Final = 1e-3
_BATCH: Final = 2048


@dataclass(frozen=True)
class Demonstrations:
    """Observations and the expert's actions for them, n samples."""

    observation: Singles  # [n, size]
    action: Singles  # [n, 12]


def imitate(
    config: TrainingConfig,
    actor: nn.Module,
    mirror: Mirror,
    report: Callable[[float], None] = lambda share: None,
) -> float:
    """Fit a network (observations [n, size] → actions [n, 12]) to the gait of `config.imitation`.

    report: called with the share that is done. Returns the RMS error of the actions in the last
    round.
    """
    expert = _Demonstrator(config)
    rounds: list[Demonstrations] = []
    error = np.nan
    count = config.imitation.rounds
    for number, share in enumerate((*_FIRST_SHARES, *[_SHARE] * count)[:count]):
        rounds.append(expert.demonstrate(actor, share))
        error = _fit(actor, mirror, rounds, config.imitation.epochs)
        report((number + 1) / count)
    return error


class _Demonstrator:
    """Robots that the expert policy leads by random commands."""

    def __init__(self, config: TrainingConfig) -> None:
        plan, commands = config.imitation, config.commands
        gait = replace(
            load_gait(plan.gait),
            frequency=config.stride_frequency,
            frequency_per_speed=config.frequency_per_speed,
            cadence_adaptation=config.cadence_adaptation,
            max_forward=min(commands.forward, 1.5),
            max_lateral=min(commands.lateral, 1.0),
            max_yaw=min(commands.yaw, 2.0),
        )
        changes = {
            'physics.environments': plan.robots,
            'commands.ramp_from': 1.0,
            'random.pose': 0.3,
            'random.velocity': 0.3,
        }
        self._environment = WalkingEnvironment(config.with_values(changes))
        self._expert = ExpertPolicy(self._environment, [gait], load_gait_table(plan.gait))
        self._random = np.random.default_rng([config.seed, 1])
        self._steps = round(plan.seconds / config.step_time)
        self._standing_up = round(RAMP / config.step_time) + 5  # steps, not demonstrated

    def demonstrate(self, actor: nn.Module, share: float) -> Demonstrations:
        """Walk on, with a share of the actor in the actions."""
        environment, expert = self._environment, self._expert
        noise_level = _ACTION_NOISE * (np.arange(environment.count) % 2)[:, None]
        observations, actions = [], []
        for _ in range(self._steps):
            action = expert.actions()
            environment.gait_phase.phase[:] = expert.phases
            observation = environment.observe()
            valid = environment.age >= self._standing_up
            observations.append(observation[valid])
            actions.append(action[valid])
            with torch.no_grad():
                own = actor(torch.from_numpy(observation)).numpy() if share else 0.0
            noise = noise_level * self._random.standard_normal(action.shape)
            outcome = environment.step((1.0 - share) * action + share * own + noise)
            expert.reset(outcome.done)
        return Demonstrations(
            np.concatenate(observations), np.concatenate(actions).astype(np.float32)
        )


def _fit(actor: nn.Module, mirror: Mirror, rounds: list[Demonstrations], epochs: int) -> float:
    observations = torch.from_numpy(np.concatenate([each.observation for each in rounds]))
    actions = torch.from_numpy(np.concatenate([each.action for each in rounds]))
    optimiser = torch.optim.Adam(actor.parameters(), lr=_RATE)
    losses: list[float] = []
    for epoch in range(epochs):
        losses.clear()
        for part in torch.randperm(len(observations)).split(_BATCH):
            observation, action = observations[part], actions[part]
            if epoch % 2:
                observation, action = mirror.observations(observation), mirror.actions(action)
            loss = nn.functional.mse_loss(actor(observation), action)
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            losses.append(loss.item())
    return float(np.sqrt(np.mean(losses)))
