"""Tiny policy folders for tests."""

import numpy as np
from policy_runner.policies.folder import Action, Contract, Network, write_folder
from policy_runner.policies.kinematics import DEFAULT_POSE, JOINT_NAMES
from policy_runner.policies.observations import STANDARD

HIDDEN = (4,)


def contract(joints=JOINT_NAMES, name='tiny', rate=50.0, observation=STANDARD, hidden=HIDDEN):
    pose = dict(zip(JOINT_NAMES, DEFAULT_POSE, strict=True))
    return Contract(
        name=name,
        rate=rate,
        joints=tuple(joints),
        default_pose=tuple(float(pose[joint]) for joint in joints),
        stiffness=(80.0,) * 12,
        damping=(2.0,) * 12,
        action=Action((0.5,) * 12),
        observation=observation,
        network=Network(hidden),
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
