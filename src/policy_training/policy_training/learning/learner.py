"""PPO of rsl-rl on the walking environment, in rounds of collecting and learning."""

import contextlib
import io
import time
from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np
import torch
from rsl_rl.algorithms import PPO
from rsl_rl.env import VecEnv
from tensordict import TensorDict
from wattwalk_core.anymal import JOINT_NAMES
from wattwalk_core.arrays import Singles
from wattwalk_core.errors import InputError

from policy_training.config import TrainingConfig
from policy_training.environment.environment import WalkingEnvironment

GROUP: Final = 'policy'
STATE: Final = 'state'


class TorchEnvironment(VecEnv):
    """Walking environment as rsl-rl takes it, in torch tensors; the simulation is on the CPU."""

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


_STD: Final = 'distribution.std_param'
_CRITIC_RATE: Final = 1e-3
_CRITIC_EPOCHS: Final = 3


class Learner:
    """PPO of a walking policy, seeded by the config; checkpoints hold tensors and numbers only.

    device: of the network and its learning, `cpu` or `cuda`; the robots stay on the CPU.
    """

    def __init__(
        self, config: TrainingConfig, environment: WalkingEnvironment, device: str = 'cpu'
    ) -> None:
        torch.manual_seed(config.seed)
        self.config = config
        self.environment = environment
        self.device = device
        self.iteration = 0
        self._steps = 0  # at the end of the last whole round
        self._torch_environment = TorchEnvironment(environment, device)
        self._observations = self._torch_environment.get_observations()
        with contextlib.redirect_stdout(io.StringIO()):
            self.ppo: PPO = PPO.construct_algorithm(
                self._observations, self._torch_environment, algorithm_settings(config), device
            )
        self._critic_optimiser = torch.optim.Adam(self.ppo.critic.parameters(), lr=_CRITIC_RATE)

    def run(
        self,
        iterations: int,
        report: Callable[[dict[str, float]], None],
        *,
        seconds: float | None = None,
    ) -> None:
        """Run up to a total of iterations, or for some seconds.

        report: called after each with its means by name.
        """
        start = time.monotonic()
        self.ppo.train_mode()
        while self.iteration < iterations:
            report(self._round())
            if seconds is not None and time.monotonic() - start >= seconds:
                return

    def checkpoint(self) -> dict[str, Any]:
        """Return networks, optimiser, counters and the state of the random numbers."""
        return {
            **self.ppo.save(),
            'critic_optimiser': self._critic_optimiser.state_dict(),
            'observation': self.environment.observation.content(),
            'iteration': self.iteration,
            'steps': self._steps,
            'random': torch.get_rng_state(),
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a checkpoint with reset robots; InputError for another observation."""
        self._check_observation(state)
        self.ppo.load(state, None, True)
        self._critic_optimiser.load_state_dict(state['critic_optimiser'])
        self.iteration = int(state['iteration'])
        self._steps = self.environment.steps = int(state['steps'])
        torch.set_rng_state(state['random'].cpu())
        self._observations = self._torch_environment.get_observations()

    def take_networks(self, state: dict[str, Any]) -> None:
        """Start from the networks of another run, with its exploration, at most the config's.

        InputError for another observation or other sizes; the rate limit of commands may differ,
        which changes what commands the robots get and not what the networks take.
        """
        self._check_observation(state, but=('command_rate_limit',))
        actor = dict(state['actor_state_dict'])
        own = self.ppo.critic.state_dict()
        if any(own[key].shape != value.shape for key, value in state['critic_state_dict'].items()):
            raise InputError('the networks of that run have other sizes than this one; begin anew')
        actor[_STD] = actor[_STD].clamp_max(self.config.ppo.std)
        self.ppo.load({**state, 'actor_state_dict': actor}, {'actor': True, 'critic': True}, True)

    def _check_observation(self, state: dict[str, Any], but: Sequence[str] = ()) -> None:
        seen = self.environment.observation.content()
        before = state.get('observation', seen)
        for key in ('terms', 'clip', 'command_rate_limit'):
            if key not in but and seen.get(key) != before.get(key):
                raise InputError(
                    f'that run was trained with {key} {before.get(key)!r}, this one has '
                    f'{seen.get(key)!r}; set it as it was, or begin anew'
                )

    def actor_tensors(self) -> dict[str, Singles]:
        """Return weight [out, in] and bias [out] of each layer, by name in a policy folder."""
        modules = self.ppo.get_policy().mlp
        layers = [module for module in modules if isinstance(module, torch.nn.Linear)]
        return {
            f'layer{index}.{part}': tensor.detach().cpu().numpy()
            for index, layer in enumerate(layers)
            for part, tensor in layer.named_parameters()
        }

    def _fit_critic(self) -> None:
        """Fit the critic to the round's returns at a learning rate of its own.

        PPO has one rate for both, with little exploration a hundredth of that which a critic
        needs; a critic that lags behind makes the advantages noisy.
        """
        storage, critic = self.ppo.storage, self.ppo.critic
        seen, returns = storage.observations.flatten(0, 1), storage.returns.flatten(0, 1)
        size = -(-len(returns) // self.config.ppo.minibatches)
        for _ in range(_CRITIC_EPOCHS):
            for part in torch.randperm(len(returns), device=returns.device).split(size):
                loss = torch.nn.functional.mse_loss(critic(seen[part]), returns[part])
                self._critic_optimiser.zero_grad()
                loss.backward()
                self._critic_optimiser.step()

    def _round(self) -> dict[str, float]:
        config = self.config
        began = time.perf_counter()
        logs: list[dict[str, float]] = []
        with torch.inference_mode():
            for _ in range(config.ppo.steps):
                actions = self.ppo.act(self._observations)
                self._observations, rewards, dones, extras = self._torch_environment.step(actions)
                self.ppo.process_env_step(self._observations, rewards, dones, extras)
                logs.append(self._torch_environment.log)
            collected = time.perf_counter()
            self.ppo.compute_returns(self._observations)
            _clip_advantages(self.ppo.storage.advantages, config.ppo.advantage_clip)
        self._fit_critic()
        losses: dict[str, float] = self.ppo.update()
        ended = time.perf_counter()
        self.iteration += 1
        self._steps = self.environment.steps
        values = {name: float(np.mean([log[name] for log in logs])) for name in logs[0]}
        values.update({f'loss/{name}': value for name, value in losses.items()})
        values['learning_rate'] = self.ppo.learning_rate
        values['action_std'] = float(self.ppo.get_policy().output_std.detach().mean())
        steps = config.ppo.steps * self.environment.count
        return values | {
            'rate/collect': steps / (collected - began),
            'rate/all': steps / (ended - began),
        }


def _clip_advantages(advantages: torch.Tensor, most: float) -> None:
    """Clip normalised advantages [T, N, 1] to ±most in place, and normalise them again.

    A fall is worth tens of standard deviations; a few hundred robots would learn of nothing else.
    """
    advantages.clamp_(-most, most)
    advantages -= advantages.mean()
    advantages /= advantages.std() + 1e-8


def algorithm_settings(config: TrainingConfig) -> dict[str, Any]:
    """Return rsl-rl's settings of PPO and of its networks for a config."""
    ppo = config.ppo
    network = {'class_name': 'MLPModel', 'hidden_dims': list(ppo.hidden), 'activation': 'elu'}
    return {
        'num_steps_per_env': ppo.steps,
        'obs_groups': {'actor': [GROUP], 'critic': [STATE]},
        'multi_gpu': None,
        'torch_compile_mode': None,
        'actor': {
            **network,
            'distribution_cfg': {
                'class_name': 'GaussianDistribution',
                'init_std': ppo.std,
                'learn_std': True,
            },
        },
        'critic': network,
        'algorithm': {
            'class_name': 'PPO',
            'num_learning_epochs': ppo.epochs,
            'num_mini_batches': ppo.minibatches,
            'clip_param': ppo.clip,
            'gamma': ppo.gamma,
            'lam': ppo.lambda_,
            'entropy_coef': ppo.entropy,
            'learning_rate': ppo.learning_rate,
            'desired_kl': ppo.desired_kl,
            'schedule': 'adaptive',
            'max_grad_norm': ppo.gradient_norm,
            'symmetry_cfg': None,
        },
    }
