"""The environment behind the interface of rsl-rl."""

from typing import Final

import numpy as np
import torch
from rsl_rl.env import VecEnv
from tensordict import TensorDict
from wattwalk_core.anymal import JOINT_NAMES

from policy_training.environment.environment import WalkingEnvironment

GROUP: Final = 'policy'
STATE: Final = 'state'


class TorchEnvironment(VecEnv):
    """N robots behind torch tensors; the simulation runs on the CPU."""

    def __init__(self, environment: WalkingEnvironment, device: str) -> None:
        self.walking = environment
        self.num_envs = environment.count
        self.num_actions = len(JOINT_NAMES)
        self.max_episode_length = environment.longest
        self.episode_length_buf = torch.zeros(self.num_envs, dtype=torch.long)
        self.device = device
        self.cfg = environment.config.content()
        self.log: dict[str, float] = {}

    def get_observations(self) -> TensorDict:
        """Return the present observations and states."""
        return self._pack(self.walking.observe(), self.walking.state())

    def step(
        self, actions: torch.Tensor
    ) -> tuple[TensorDict, torch.Tensor, torch.Tensor, dict[str, torch.Tensor]]:
        """Return observations, rewards, ends of episodes and, of these, time-outs.

        A new command or a push ends an episode as a time-out does, though the robot
        continues: its consequences are not due to the actions before, and with a few hundred
        robots would hide those that are.
        """
        outcome = self.walking.step(actions.cpu().numpy())
        self.log = outcome.log
        return (
            self._pack(outcome.observation, outcome.state),
            torch.from_numpy(outcome.reward.astype(np.float32)).to(self.device),
            torch.from_numpy(outcome.done | outcome.disturbed).to(self.device),
            {'time_outs': torch.from_numpy(outcome.timed_out | outcome.disturbed).to(self.device)},
        )

    def _pack(self, observation: np.ndarray, state: np.ndarray) -> TensorDict:
        seen = {GROUP: torch.from_numpy(observation), STATE: torch.from_numpy(state)}
        return TensorDict(seen, batch_size=[self.num_envs]).to(self.device)
