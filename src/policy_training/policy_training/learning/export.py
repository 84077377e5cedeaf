"""Export of a trained network as a policy folder."""

from collections.abc import Mapping, Sequence
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

from policy_training.config import TrainingConfig
from policy_training.environment.environment import ACTION_CLIP

Layers = Sequence[tuple[torch.Tensor, torch.Tensor]]


def export_policy(
    folder: Path,
    layers: Layers,
    config: TrainingConfig,
    observation: Observation,
    training: Mapping[str, Any],
) -> None:
    """
    Write `policy.yaml` and `weights.safetensors`.

    layers: weight [out, in] and bias [out] of each layer, as trained on this observation.
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
        network=PolicyNetwork(tuple(len(bias) for _, bias in layers[:-1])),
        training=dict(training),
    )
    tensors = {}
    for index, (weight, bias) in enumerate(layers):
        tensors[f'layer{index}.weight'] = weight.numpy()
        tensors[f'layer{index}.bias'] = bias.numpy()
    write_folder(folder, contract, tensors)
