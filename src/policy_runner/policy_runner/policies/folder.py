"""
A policy on disk: a folder with `policy.yaml`, the contract by names, and `weights.safetensors`.

Nothing in it is code, and everything is checked on reading.
"""

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load, save_file
from wattwalk_core.errors import InputError

from policy_runner.policies.kinematics import JOINT_NAMES
from policy_runner.policies.observations import Observation

Floats = NDArray[np.float64]
Tensors = Mapping[str, NDArray[np.float32]]

FORMAT: Final = 'wattwalk_policy/1'
CARD: Final = 'policy.yaml'
WEIGHTS: Final = 'weights.safetensors'
_ACTIVATIONS: Final = ('elu', 'relu', 'tanh')
_REQUIRED: Final = (
    *('format', 'name', 'rate', 'joints', 'default_pose', 'gains', 'action', 'observation'),
    'network',
)


@dataclass(frozen=True)
class Action:
    """Targets are the default pose plus scale (rad, one per joint) times the clipped output."""

    scale: tuple[float, ...]
    clip: float = 100.0


@dataclass(frozen=True)
class Network:
    """A multi-layer perceptron: widths of the hidden layers and what follows each."""

    hidden: tuple[int, ...]
    activation: str = 'elu'

    def __post_init__(self) -> None:
        if self.activation not in _ACTIVATIONS:
            raise InputError(
                f'activation is {self.activation!r}; it is one of {", ".join(_ACTIVATIONS)}'
            )
        if not all(isinstance(n, int) and 1 <= n <= 4096 for n in self.hidden):
            raise InputError(f'hidden is {list(self.hidden)}; it must list widths in 1..4096')

    def shapes(self, inputs: int, outputs: int) -> dict[str, tuple[int, ...]]:
        """Shape of each tensor by name."""
        widths = (inputs, *self.hidden, outputs)
        shapes: dict[str, tuple[int, ...]] = {}
        for layer, (before, after) in enumerate(pairwise(widths)):
            shapes[f'layer{layer}.weight'] = (after, before)
            shapes[f'layer{layer}.bias'] = (after,)
        return shapes


@dataclass(frozen=True)
class Contract:
    """
    What a policy takes and gives, by names.

    joints: the twelve of the robot, in the policy's order, which default_pose (rad), gains
    (stiffness in N·m/rad, damping in N·m·s/rad) and the action's scale follow. rate: Hz.
    training: where it comes from, free in form. InputError for what does not fit together.
    """

    name: str
    rate: float
    joints: tuple[str, ...]
    default_pose: tuple[float, ...]
    stiffness: tuple[float, ...]
    damping: tuple[float, ...]
    action: Action
    observation: Observation
    network: Network
    training: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if sorted(self.joints) != sorted(JOINT_NAMES):
            strange = next((j for j in self.joints if j not in JOINT_NAMES), None)
            missing = next((j for j in JOINT_NAMES if j not in self.joints), None)
            what = f'has {strange!r}' if strange is not None else f'lacks {missing!r}'
            raise InputError(f'joints {what}; the robot has {", ".join(JOINT_NAMES)}')
        for name in ('default_pose', 'stiffness', 'damping'):
            values = getattr(self, name)
            if len(values) != len(self.joints) or not np.isfinite(values).all():
                raise InputError(f'{name} is {list(values)}; give a finite number for each joint')
        scale = self.action.scale
        if len(scale) != len(self.joints) or not np.isfinite(scale).all() or min(scale) <= 0.0:
            raise InputError(f'action scale is {list(scale)}; give one above 0 for each joint')
        if not (np.isfinite(self.action.clip) and self.action.clip > 0.0):
            raise InputError(f'action clip is {self.action.clip!r}; it must be more than 0')
        if not 10.0 <= self.rate <= 400.0:
            raise InputError(f'rate is {self.rate!r}; it must lie in 10..400 Hz')

    def check(self, tensors: Tensors) -> None:
        """InputError for a tensor that is missing, strange, of another shape or not finite."""
        expected = self.network.shapes(self.observation.size, len(self.joints))
        for name, shape in expected.items():
            if name not in tensors:
                raise InputError(f'{WEIGHTS} lacks {name!r}')
            values = tensors[name]
            if values.shape != shape:
                raise InputError(
                    f'{name} has shape {list(values.shape)}; the contract asks for {list(shape)}'
                )
            if not np.isfinite(values).all():
                raise InputError(f'{name} holds numbers that are not finite; train it again')
        strange = [name for name in tensors if name not in expected]
        if strange:
            raise InputError(f'{WEIGHTS} has {strange[0]!r}, which the contract does not name')

    def content(self) -> dict[str, Any]:
        """What `parse` reads."""
        joints = self.joints
        return {
            'format': FORMAT,
            'name': self.name,
            'rate': self.rate,
            'joints': list(joints),
            'default_pose': dict(zip(joints, self.default_pose, strict=True)),
            'gains': {
                joint: {'stiffness': kp, 'damping': kd}
                for joint, kp, kd in zip(joints, self.stiffness, self.damping, strict=True)
            },
            'action': {
                'scale': dict(zip(joints, self.action.scale, strict=True)),
                'clip': self.action.clip,
            },
            'observation': self.observation.content(),
            'network': {
                'hidden': list(self.network.hidden),
                'activation': self.network.activation,
            },
            'training': dict(self.training),
        }

    @classmethod
    def parse(cls, content: object) -> 'Contract':
        """From the mapping in policy.yaml; InputError says what is missing or wrong."""
        if not isinstance(content, Mapping):
            raise InputError(f'it must be a mapping, not {content!r}')
        for key in _REQUIRED:
            if key not in content:
                raise InputError(f'it lacks {key!r}')
        if content['format'] != FORMAT:
            raise InputError(f'format is {content["format"]!r}; this reads {FORMAT!r}')
        joints = content['joints']
        if not isinstance(joints, list) or not all(isinstance(j, str) for j in joints):
            raise InputError(f'joints must list names, not {joints!r}')
        action, network = _mapping(content, 'action'), _mapping(content, 'network')
        hidden = network.get('hidden')
        if not isinstance(hidden, list):
            raise InputError(f'network.hidden must list widths, not {hidden!r}')
        gains = _by_joint(content, 'gains', joints)
        return cls(
            name=str(content['name']),
            rate=_number(content['rate'], 'rate'),
            joints=tuple(joints),
            default_pose=_numbers(_by_joint(content, 'default_pose', joints), 'default_pose'),
            stiffness=_numbers([_of(gain, 'stiffness') for gain in gains], 'stiffness'),
            damping=_numbers([_of(gain, 'damping') for gain in gains], 'damping'),
            action=Action(
                _numbers(_by_joint(action, 'scale', joints), 'action scale'),
                _number(action.get('clip', 100.0), 'action clip'),
            ),
            observation=Observation.parse(content['observation']),
            network=Network(tuple(hidden), str(network.get('activation', 'elu'))),
            training=_mapping(content, 'training') if 'training' in content else {},
        )


def write_folder(folder: Path, contract: Contract, tensors: Tensors) -> None:
    """Write a policy; each file whole or not at all. InputError where they do not fit."""
    contract.check(tensors)
    folder.mkdir(parents=True, exist_ok=True)
    part = folder / f'{WEIGHTS}.part'
    save_file({name: np.ascontiguousarray(values) for name, values in tensors.items()}, part)
    os.replace(part, folder / WEIGHTS)
    part = folder / f'{CARD}.part'
    part.write_text(
        yaml.safe_dump(contract.content(), sort_keys=False, allow_unicode=True, width=98),
        encoding='utf-8',
    )
    os.replace(part, folder / CARD)


def read_folder(folder: Path) -> tuple[Contract, dict[str, NDArray[np.float32]]]:
    """Read and check a policy; InputError names the folder and what is wrong in one line."""
    try:
        text = (folder / CARD).read_text(encoding='utf-8')
        contract = Contract.parse(yaml.safe_load(text))
        tensors = load((folder / WEIGHTS).read_bytes())
        contract.check(tensors)
    except OSError as error:
        raise InputError(
            f'policy {folder}: cannot read {Path(error.filename).name} ({error.strerror})'
        ) from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        line = ' '.join(str(error).split())
        raise InputError(f'policy {folder}: {CARD} is no YAML: {line}') from error
    except (SafetensorError, ValueError, TypeError) as error:
        raise InputError(f'policy {folder}: {WEIGHTS} is damaged ({error})') from error
    except InputError as error:
        raise InputError(f'policy {folder}: {error}') from None
    return contract, {name: values.astype(np.float32) for name, values in tensors.items()}


def _mapping(content: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    value = content[key]
    if not isinstance(value, Mapping):
        raise InputError(f'{key} must be a mapping, not {value!r}')
    return value


def _by_joint(content: Mapping[str, Any], key: str, joints: list[str]) -> list[Any]:
    values = content.get(key)
    if not isinstance(values, Mapping):
        raise InputError(f'{key} must map joints to values, not {values!r}')
    for joint in joints:
        if joint not in values:
            raise InputError(f'{key} lacks {joint!r}')
    return [values[joint] for joint in joints]


def _of(gain: object, key: str) -> object:
    if not isinstance(gain, Mapping) or key not in gain:
        raise InputError(f'gains need stiffness and damping, not {gain!r}')
    return gain[key]


def _numbers(values: list[Any], name: str) -> tuple[float, ...]:
    return tuple(_number(value, name) for value in values)


def _number(value: object, name: str) -> float:
    if not isinstance(value, int | float) or isinstance(value, bool) or not math.isfinite(value):
        raise InputError(f'{name} is {value!r}; it must be a finite number')
    return float(value)
