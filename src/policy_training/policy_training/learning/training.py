"""Training from a config to the exported policy, with progress on stderr."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from policy_runner.policies.folder import (
    FORMAT,
    Action,
    Contract,
    Gains,
    PolicyNetwork,
    write_folder,
)
from policy_runner.policies.observations import Observation
from wattwalk_core.anymal import DEFAULT_POSE, JOINT_NAMES, POSITION_GAIN, VELOCITY_GAIN
from wattwalk_core.console import counting_bar
from wattwalk_core.tensors import Tensors

import policy_training
from policy_training.config import TrainingConfig
from policy_training.environment.environment import ACTION_CLIP, WalkingEnvironment
from policy_training.environment.power_source import power_source
from policy_training.learning.learner import Learner
from policy_training.learning.run_folder import RunFolder, read_curves


def export_policy(
    folder: Path,
    tensors: Tensors,
    config: TrainingConfig,
    observation: Observation,
    training: Mapping[str, Any],
) -> None:
    """Write `policy.yaml` and `weights.safetensors` of a policy into a folder.

    tensors: of each layer by name, as trained on this observation.
    training: origin of the policy, for people.
    """
    pose = (round(float(q), 6) + 0.0 for q in DEFAULT_POSE)
    contract = Contract(
        FORMAT,
        name=config.name,
        rate=1.0 / config.step_time,
        joints=JOINT_NAMES,
        default_pose=dict(zip(JOINT_NAMES, pose, strict=True)),
        gains=dict.fromkeys(JOINT_NAMES, Gains(POSITION_GAIN, VELOCITY_GAIN)),
        action=Action(dict.fromkeys(JOINT_NAMES, config.action_scale), ACTION_CLIP),
        observation=observation,
        network=PolicyNetwork(config.ppo.hidden),
        training=dict(training),
    )
    write_folder(folder, contract, tensors)


def make_learner(config: TrainingConfig, device: str = 'cpu') -> Learner:
    """Return a learner with the environment and power source of a config; InputError if bad."""
    torch.set_num_threads(max(1, config.physics.threads or torch.get_num_threads()))
    return Learner(config, WalkingEnvironment(config, power=power_source(config)), device)


def train(learner: Learner, folder: RunFolder, *, seconds: float | None = None) -> None:
    """Train to the end of the config, or for some seconds; save curves, checkpoint and policy."""
    config = learner.config
    bar = counting_bar('M steps', digits=1)

    def report(values: dict[str, float]) -> None:
        steps = learner.environment.steps
        folder.add(learner.iteration, steps, values)
        bar.update(task, completed=steps / 1e6, description=_headline(config, values))
        if learner.iteration % config.checkpoint_every == 0:
            folder.save(learner.checkpoint())

    with bar:
        task = bar.add_task(config.name, total=config.steps / 1e6)
        try:
            learner.run(config.iterations, report, seconds=seconds)
        except KeyboardInterrupt:
            bar.console.print(f'stopped; --resume -o {folder.path} goes on')
            raise
        finally:
            folder.save(learner.checkpoint())
            folder.close()
    rows = read_curves(folder.path)
    export_policy(
        folder.policy,
        learner.actor_tensors(),
        config,
        learner.environment.observation,
        {
            'software': f'policy_training {policy_training.__version__}',
            'steps': learner.environment.steps,
            'seed': config.seed,
            'power_model': config.power.model,
            'power_weight': config.power.weight,
            'torque_weight': config.rewards.torques,
            'last_round': rows[-1] if rows else {},
        },
    )
    bar.console.print(f'wrote {folder.policy}')


def _headline(config: TrainingConfig, v: Mapping[str, float]) -> str:
    watts = f', {v["power/watts"]:.0f} W' if 'power/watts' in v else ''
    return (
        f'{config.name}: off by {v["error/velocity"]:.2f} m/s, {v["error/yaw"]:.2f} rad/s'
        f'{watts}, {v["rate/all"] / 1e3:.1f} k steps/s'
    )
