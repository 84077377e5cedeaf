"""The environment behind the interface of rsl-rl, and its mirror image."""

from typing import Final

import numpy as np
import torch
from policy_runner.policies.observations import Observation
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


class Mirror:
    """Mirror images of observations and actions, left for right.

    Called as rsl-rl's symmetry extension calls it, with observations and actions or None.
    """

    def __init__(self, observation: Observation) -> None:
        places, signs = _mirrored_joints()
        order, flips = np.arange(observation.size), np.ones(observation.size)
        for name in observation.names:
            part = observation.part(name)
            if name in ('base_velocity', 'gravity'):
                flips[part] = (1.0, -1.0, 1.0)
            elif name == 'angular_velocity':
                flips[part] = (-1.0, 1.0, -1.0)
            elif name == 'command':
                flips[part] = (1.0, -1.0, -1.0)
            elif name == 'gait_clock':
                flips[part] = -1.0  # the other pair of legs is half a stride on
            else:
                order[part] = part.start + places
                flips[part] = signs
        self._order, self._flips = torch.from_numpy(order), torch.from_numpy(flips).float()
        self._places, self._signs = torch.from_numpy(places), torch.from_numpy(signs).float()

    def __call__(
        self,
        env: VecEnv | None = None,
        obs: TensorDict | None = None,
        actions: torch.Tensor | None = None,
    ) -> tuple[TensorDict | None, torch.Tensor | None]:
        """Return the batch followed by its mirror image."""
        if obs is not None:
            seen, state = obs[GROUP], obs[STATE]
            both = {
                GROUP: torch.cat([seen, self.observations(seen)]),
                STATE: torch.cat([state, self.states(state)]),
            }
            obs = TensorDict(both, batch_size=[2 * len(seen)], device=seen.device)
        if actions is not None:
            actions = torch.cat([actions, self.actions(actions)])
        return obs, actions

    def observations(self, values: torch.Tensor) -> torch.Tensor:
        """Return mirror images of observations [N, size]."""
        return values[:, self._order.to(values.device)] * self._flips.to(values.device)

    def states(self, values: torch.Tensor) -> torch.Tensor:
        """Return mirror images of states [N, size + 11]: observation, feet and command."""
        size = len(self._order)
        seen, feet, command = values.split([size, 8, 3], dim=1)
        feet = feet.reshape(-1, 2, 2, 2).flip(3).reshape(-1, 8)
        command = command * command.new_tensor([1.0, -1.0, -1.0])
        return torch.cat([self.observations(seen), feet, command], dim=1)

    def actions(self, values: torch.Tensor) -> torch.Tensor:
        """Return mirror images of actions [N, 12]."""
        return values[:, self._places.to(values.device)] * self._signs.to(values.device)


def _mirrored_joints() -> tuple[np.ndarray, np.ndarray]:
    swapped = [{'L': 'R', 'R': 'L'}[name[0]] + name[1:] for name in JOINT_NAMES]
    places = np.array([JOINT_NAMES.index(name) for name in swapped])
    signs = np.array([-1.0 if name.endswith('HAA') else 1.0 for name in JOINT_NAMES])
    return places, signs
