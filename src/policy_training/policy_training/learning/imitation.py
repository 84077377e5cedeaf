"""
A first gait to improve: the policy learns to do what the scripted trot does.

From random networks, PPO on a few hundred robots stands still for millions of steps: feet that
chatter cost more than they gain. So the policy begins with the trot's answers to what it sees.
It is shown them along its own way, too: part of each action is its own while the trot says what
to do (DAgger, Ross et al. 2011), since what it copies from the trot's way alone does not hold.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import torch
from numpy.typing import NDArray
from policy_runner.policies.trot import TROTS
from torch import nn

from policy_training.config import TrainingConfig
from policy_training.environment.environment import WalkingEnvironment
from policy_training.environment.expert_policy import RAMP, Leaders
from policy_training.environment.vec_env import Mirror

Floats = NDArray[np.float32]

_SHARES: Final = (0.0, 0.4, 0.7)  # of the policy in the action, round by round
_SHAKE: Final = 0.15  # noise on the actions of every other robot, standard deviation
_RATE: Final = 1e-3
_BATCH: Final = 2048


@dataclass(frozen=True)
class Demonstrations:
    """What was seen and what the trot would do there: n samples."""

    observation: Floats  # [n, size]
    action: Floats  # [n, 12]


def imitate(
    config: TrainingConfig,
    actor: nn.Module,
    mirror: Mirror,
    report: Callable[[float], None] = lambda share: None,
) -> float:
    """
    Fit a network (observations [n, size] → actions [n, 12]) to the gait of `config.imitation`.

    report: told the share that is done. Returns the root mean square of what is left of the
    actions in the last round.
    """
    teacher = _Teacher(config)
    rounds: list[Demonstrations] = []
    left = np.nan
    for number, share in enumerate(_SHARES):
        rounds.append(teacher.show(actor, share))
        left = _fit(actor, mirror, rounds, config.imitation.epochs)
        report((number + 1) / len(_SHARES))
    return left


class _Teacher:
    """The trot at the head of many robots, by random commands."""

    def __init__(self, config: TrainingConfig) -> None:
        plan = config.imitation
        asked = config.commands
        gait = replace(
            TROTS[plan.gait],
            frequency=config.stride_frequency,
            cadence_adaptation=config.hurry,
            max_forward=min(asked.forward, 1.5),
            max_lateral=min(asked.lateral, 1.0),
            max_yaw=min(asked.yaw, 2.0),
        )
        self._environment = WalkingEnvironment(
            replace(
                config,
                physics=replace(config.physics, environments=plan.robots),
                commands=replace(asked, ramp_from=1.0),
                random=replace(config.random, pose=0.3, velocity=0.3),
            )
        )
        self._leaders = Leaders(self._environment, gait)
        self._random = np.random.default_rng([config.seed, 1])
        self._steps = round(plan.seconds / config.step_time)
        self._settled = (
            round(RAMP / config.step_time) + 5
        )  # while it rises, it is not learned from

    def show(self, actor: nn.Module, share: float) -> Demonstrations:
        """Walk on, with a share of the actor in the actions."""
        environment, leaders = self._environment, self._leaders
        shaken = _SHAKE * (np.arange(environment.count) % 2)[:, None]
        seen, done = [], []
        for _ in range(self._steps):
            action = leaders.actions()
            environment.clock.phase[:] = leaders.strides
            observation = environment.observe()
            valid = environment.age >= self._settled
            seen.append(observation[valid])
            done.append(action[valid])
            with torch.no_grad():
                own = actor(torch.from_numpy(observation)).numpy() if share else 0.0
            noise = shaken * self._random.standard_normal(action.shape)
            outcome = environment.step((1.0 - share) * action + share * own + noise)
            leaders.reset(outcome.done)
        return Demonstrations(np.concatenate(seen), np.concatenate(done).astype(np.float32))


def _fit(actor: nn.Module, mirror: Mirror, rounds: list[Demonstrations], epochs: int) -> float:
    seen = torch.from_numpy(np.concatenate([shown.observation for shown in rounds]))
    done = torch.from_numpy(np.concatenate([shown.action for shown in rounds]))
    optimiser = torch.optim.Adam(actor.parameters(), lr=_RATE)
    losses: list[float] = []
    for epoch in range(epochs):
        losses.clear()
        for part in torch.randperm(len(seen)).split(_BATCH):
            observation, action = seen[part], done[part]
            if epoch % 2:
                observation, action = mirror.observations(observation), mirror.actions(action)
            loss = nn.functional.mse_loss(actor(observation), action)
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            losses.append(loss.item())
    return float(np.sqrt(np.mean(losses)))
