"""Tiny policy folders for tests."""

import numpy as np
from policy_runner.policies.folder import (
    FORMAT,
    Action,
    Contract,
    Gains,
    PolicyNetwork,
    write_folder,
)
from policy_runner.policies.observations import STANDARD
from wattwalk_core.anymal import DEFAULT_POSE, JOINT_NAMES

HIDDEN = (4,)


def contract(joints=JOINT_NAMES, name='tiny', rate=50.0, observation=STANDARD, hidden=HIDDEN):
    pose = dict(zip(JOINT_NAMES, DEFAULT_POSE, strict=True))
    return Contract(
        FORMAT,
        name=name,
        rate=rate,
        joints=tuple(joints),
        default_pose={joint: float(pose[joint]) for joint in joints if joint in pose},
        gains={joint: Gains(80.0, 2.0) for joint in joints},
        action=Action(dict.fromkeys(joints, 0.5)),
        observation=observation,
        network=PolicyNetwork(hidden),
    )


def tensors(of, scale=0.0, seed=0):
    random = np.random.default_rng(seed)
    shapes = of.network.shapes(of.observation.size, 12)
    return {n: (scale * random.standard_normal(s)).astype(np.float32) for n, s in shapes.items()}


def save(folder, scale=0.0, **changes):
    """A policy with random weights of a size; with scale 0 it stands in the default pose."""
    made = contract(**changes)
    write_folder(folder, made, tensors(made, scale))
    return folder
