"""PPO of rsl-rl on the walking environment, in rounds of collecting and learning."""

import contextlib
import io
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import torch
from rsl_rl.algorithms import PPO
from wattwalk_core.errors import InputError

from policy_training.config import TrainingConfig
from policy_training.environment.environment import WalkingEnvironment
from policy_training.environment.vec_env import GROUP, STATE, Mirror, TorchEnvironment
from policy_training.learning.imitation import imitate
from policy_training.learning.reference_policy import PolicyTrial, ReferencePolicy

_STD: Final = 'distribution.std_param'
_CRITIC_RATE: Final = 1e-3
_CRITIC_EPOCHS: Final = 3
_CALM_PERIOD: Final = 100  # policy steps between calm spells of a robot
_SHOWN: Final = ('cost', 'power', 'knees', 'falls', 'speed_error', 'yaw_error')

Layers = list[tuple[torch.Tensor, torch.Tensor]]


@dataclass
class Round:
    """Result of one iteration."""

    iteration: int
    steps: int  # policy steps so far
    values: dict[str, float] = field(default_factory=dict)  # means over the round


class Learner:
    """Seeded PPO with checkpoints, dicts of tensors and numbers.

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
        self._calm_phase = torch.randint(_CALM_PERIOD, (environment.count,))
        self._torch_environment = TorchEnvironment(environment, device)
        self._observations = self._torch_environment.get_observations()
        with contextlib.redirect_stdout(io.StringIO()):
            self.ppo: PPO = PPO.construct_algorithm(
                self._observations,
                self._torch_environment,
                algorithm_settings(config, environment),
                device,
            )
        self._critic_optimiser = torch.optim.Adam(self.ppo.critic.parameters(), lr=_CRITIC_RATE)
        self._reference: ReferencePolicy | None = None
        self._critic_first = 0  # rounds in which the critic learns alone
        self._trial = PolicyTrial(config, environment.observation)
        self._best: tuple[float, Layers] | None = None

    def run(
        self, iterations: int, report: Callable[[Round], None], *, seconds: float | None = None
    ) -> None:
        """Run until a number of iterations is done, or for some seconds."""
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
            'steps': self.environment.steps,
            'random': torch.get_rng_state(),
            'critic_first': self._critic_first,
            'power_multiplier': self.environment.power_multiplier,
            **({'reference_policy': self._reference.content()} if self._reference else {}),
            **({'best': {'cost': self._best[0], 'layers': self._best[1]}} if self._best else {}),
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a checkpoint with reset robots; InputError for another observation."""
        self._check_observation(state)
        self.ppo.load(state, None, True)
        self._critic_optimiser.load_state_dict(state['critic_optimiser'])
        if self.config.ppo.anchor_rate > 0.0:
            if 'reference_policy' not in state:
                raise InputError(
                    'that run has no reference policy; resume it with ppo.anchor_rate=0'
                )
            self._set_reference(state['reference_policy'], go_on=True)
        self._critic_first = int(state.get('critic_first', 0))
        self.environment.power_multiplier = float(state.get('power_multiplier', 1.0))
        if 'best' in state:
            layers = [(weight, bias) for weight, bias in state['best']['layers']]
            self._best = (float(state['best']['cost']), layers)
        self.iteration = int(state['iteration'])
        self.environment.steps = int(state['steps'])
        torch.set_rng_state(state['random'].cpu())
        self._observations = self._torch_environment.get_observations()

    def take_networks(self, state: dict[str, Any]) -> None:
        """Start from the networks of another run, with the exploration of the config.

        The reference policy is that of the run, or its policy where it has none. InputError for
        another observation or other sizes; commands may be rate-limited otherwise, which changes
        what the robots are told and not what the networks take.
        """
        self._check_observation(state, but=('command_rate_limit',))
        actor = dict(state['actor_state_dict'])
        own = self.ppo.critic.state_dict()
        if any(own[key].shape != value.shape for key, value in state['critic_state_dict'].items()):
            raise InputError('the networks of that run have other sizes than this one; begin anew')
        actor[_STD] = torch.full_like(actor[_STD], self.config.ppo.std)
        self.ppo.load({**state, 'actor_state_dict': actor}, {'actor': True, 'critic': True}, True)
        self._set_reference(state.get('reference_policy'))

    def _check_observation(self, state: dict[str, Any], but: Sequence[str] = ()) -> None:
        seen = self.environment.observation.content()
        before = state.get('observation', seen)
        for key in {**seen, **before}:
            if key not in but and seen.get(key) != before.get(key):
                raise InputError(
                    f'that run was trained with {key} {before.get(key)!r}, this one has '
                    f'{seen.get(key)!r}; set it as it was, or begin anew'
                )

    def imitate_expert(self, report: Callable[[float], None]) -> float:
        """Learn the config's scripted gait; return the RMS error of the actions."""
        actor = self.ppo.actor.mlp.cpu()
        error = imitate(self.config, actor, Mirror(self.environment.observation), report)
        actor.to(self.device)
        self._set_reference()
        self._critic_first = self.config.imitation.critic_rounds
        return error

    def _set_std(self, std: float) -> None:
        actor = self.ppo.actor
        actor.load_state_dict(
            {**actor.state_dict(), _STD: torch.full_like(actor.state_dict()[_STD], std)}
        )

    def _select(self) -> dict[str, float]:
        """Try the policy on the tasks; keep it if it is the best, and move the multiplier."""
        limits, power, environment = self.config.selection, self.config.power, self.environment
        score = self._trial.run(self.actor_layers(), self.config.seed)
        if self._best is None or score.cost < self._best[0]:
            self._best = (score.cost, [(w.clone(), b.clone()) for w, b in self.actor_layers()])
        kept = (
            score.speed_error <= limits.speed_error
            and score.yaw_error <= limits.yaw_error
            and score.falls <= limits.falls
        )
        rate = power.multiplier_rate
        multiplier = environment.power_multiplier * (1.0 + rate if kept else 1.0 - 2.0 * rate)
        environment.power_multiplier = min(max(multiplier, 1.0), power.most_multiplier)
        return {
            **{f'trial/{name}': getattr(score, name) for name in _SHOWN},
            'trial/multiplier': environment.power_multiplier,
        }

    def _set_reference(self, content: dict[str, Any] | None = None, go_on: bool = False) -> None:
        """Anchor to the present policy, or to the reference of a checkpoint."""
        ppo = self.config.ppo
        if ppo.anchor_rate > 0.0:
            self._reference = ReferencePolicy(
                self.ppo.actor.mlp,
                self.environment.observation,
                tolerance=ppo.anchor_tolerance,
                rate=ppo.anchor_rate,
                least_urgency=ppo.anchor_urgency,
            )
            if content is not None:
                self._reference.restore(content, go_on=go_on)

    def chosen_layers(self) -> Layers:
        """Return the layers of the policy whose trial cost least, else of the present one."""
        return self.actor_layers() if self._best is None else self._best[1]

    def actor_layers(self) -> Layers:
        """Return weight [out, in] and bias [out] of each layer of the policy."""
        return [
            (module.weight.detach().cpu(), module.bias.detach().cpu())
            for module in self.ppo.get_policy().mlp
            if isinstance(module, torch.nn.Linear)
        ]

    def _act(self) -> torch.Tensor:
        """Draw actions; robots in a calm spell take the mean action.

        A policy whose every action is noisy may learn to rely on the noise: it walked in training
        and stood still on the robot.
        """
        actions = self.ppo.act(self._observations)
        self._calm_phase = (self._calm_phase + 1) % _CALM_PERIOD
        calm = self._calm_phase < self.config.ppo.calm * _CALM_PERIOD
        if calm.any():
            transition = self.ppo.transition
            mean = transition.distribution_params[0]
            actions = torch.where(calm[:, None].to(actions.device), mean, actions)
            transition.actions = actions
            transition.actions_log_prob = self.ppo.actor.get_output_log_prob(actions).detach()
        return actions

    def _learn(self) -> dict[str, float]:
        """Update the networks; at first the critic alone, since a new one spoils a good policy."""
        self._fit_critic()
        if self.iteration >= self._critic_first:
            losses: dict[str, float] = self.ppo.update()
            return losses | self._anchor()
        kept = {name: value.clone() for name, value in self.ppo.actor.state_dict().items()}
        losses = self.ppo.update()
        self.ppo.actor.load_state_dict(kept)
        return losses

    def _anchor(self) -> dict[str, float]:
        if self._reference is None:
            return {}
        rows = self.ppo.storage.observations.flatten(0, 1)  # the update leaves them there
        share, error = self._reference.anchor(rows[GROUP], rows[STATE])
        return {'urgent': share, 'from_reference': error}

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

    def _round(self) -> Round:
        config = self.config
        began = time.perf_counter()
        if config.ppo.std_end:
            self._set_std(config.ppo.std_at(self.environment.steps / config.steps))
        logs: list[dict[str, float]] = []
        with torch.inference_mode():
            for _ in range(config.ppo.steps):
                actions = self._act()
                self._observations, rewards, dones, extras = self._torch_environment.step(actions)
                self.ppo.process_env_step(self._observations, rewards, dones, extras)
                logs.append(self._torch_environment.log)
            collected = time.perf_counter()
            self.ppo.compute_returns(self._observations)
            _clip_advantages(self.ppo.storage.advantages, config.ppo.advantage_clip)
        losses = self._learn()
        ended = time.perf_counter()
        self.iteration += 1
        values = {name: float(np.mean([log[name] for log in logs])) for name in logs[0]}
        values.update({f'loss/{name}': value for name, value in losses.items()})
        values['learning_rate'] = self.ppo.learning_rate
        values['action_std'] = float(self.ppo.get_policy().output_std.detach().mean())
        values['rate/collect'] = config.ppo.steps * self.environment.count / (collected - began)
        values['rate/all'] = config.ppo.steps * self.environment.count / (ended - began)
        if config.selection.every and self.iteration % config.selection.every == 0:
            values |= self._select()
        return Round(self.iteration, self.environment.steps, values)


def _clip_advantages(advantages: torch.Tensor, most: float) -> None:
    """Clip normalised advantages [T, N, 1] to ±most in place, and normalise them again.

    A fall is worth tens of standard deviations; a few hundred robots would learn of nothing else.
    """
    advantages.clamp_(-most, most)
    advantages -= advantages.mean()
    advantages /= advantages.std() + 1e-8


def algorithm_settings(config: TrainingConfig, environment: WalkingEnvironment) -> dict[str, Any]:
    """Return a config as rsl-rl takes it."""
    ppo = config.ppo
    network = {'class_name': 'MLPModel', 'hidden_dims': list(ppo.hidden), 'activation': 'elu'}
    mirror = None
    if ppo.mirror:
        mirror = {
            'data_augmentation_func': Mirror(environment.observation),
            'use_data_augmentation': True,
        }
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
                'learn_std': ppo.learn_std,
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
            'symmetry_cfg': mirror,
        },
    }
