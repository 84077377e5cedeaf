"""Policy folders: `policy.yaml`, the contract by names, and `weights.safetensors`.

Nothing in a folder is code, and everything is checked on reading.
"""

from collections.abc import Mapping
from dataclasses import asdict, field
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import numpy as np
from safetensors.numpy import save
from wattwalk_core.anymal import JOINT_NAMES
from wattwalk_core.arrays import Floats, Singles
from wattwalk_core.errors import InputError
from wattwalk_core.files import write_whole
from wattwalk_core.schema import Name, Quantity, read, schema
from wattwalk_core.tensors import Tensors, checked_tensors, read_tensors
from wattwalk_core.yaml_file import dump_yaml

from policy_runner.policies.observations import Observation

FORMAT: Final = 'wattwalk_policy/1'
CARD: Final = 'policy.yaml'
WEIGHTS: Final = 'weights.safetensors'


@schema
class Action:
    """Targets are the default pose plus scale (rad, by joint) times the clipped output."""

    scale: dict[str, Annotated[float, Quantity(1e-3, 10.0, 'rad')]]
    clip: Annotated[float, Quantity(1e-3, 1e6)] = 100.0


@schema
class Gains:
    """Gains of a drive in position mode."""

    stiffness: Annotated[float, Quantity(0.0, 1e4, 'N·m/rad')]
    damping: Annotated[float, Quantity(0.0, 1e3, 'N·m·s/rad')]


@schema
class PolicyNetwork:
    """A multi-layer perceptron: widths and activation function of the hidden layers."""

    hidden: tuple[Annotated[int, Quantity(1, 4096)], ...]
    activation: Literal['elu', 'relu', 'tanh'] = 'elu'

    def shapes(self, inputs: int, outputs: int) -> dict[str, tuple[int, ...]]:
        """Return the shape of each tensor by name."""
        widths = (inputs, *self.hidden, outputs)
        shapes: dict[str, tuple[int, ...]] = {}
        for layer, (before, after) in enumerate(pairwise(widths)):
            shapes[f'layer{layer}.weight'] = (after, before)
            shapes[f'layer{layer}.bias'] = (after,)
        return shapes


@schema
class Contract:
    """Inputs and outputs of a policy, by names.

    joints: the robot's twelve in the policy's order. default_pose (rad), gains and the action's
    scale: by joint. training: origin of the policy, free in form.
    """

    format: Literal['wattwalk_policy/1']
    name: Name
    rate: Annotated[float, Quantity(10.0, 400.0, 'Hz')]
    joints: tuple[str, ...]
    default_pose: dict[str, Annotated[float, Quantity(-10.0, 10.0, 'rad')]]
    gains: dict[str, Gains]
    action: Action
    observation: Observation
    network: PolicyNetwork
    training: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if sorted(self.joints) != sorted(JOINT_NAMES):
            unknown = next((j for j in self.joints if j not in JOINT_NAMES), None)
            missing = next((j for j in JOINT_NAMES if j not in self.joints), None)
            what = f'has {unknown!r}' if unknown is not None else f'lacks {missing!r}'
            raise InputError(f'joints {what}; the robot has {", ".join(JOINT_NAMES)}')
        for name, values in (
            ('default_pose', self.default_pose),
            ('gains', self.gains),
            ('action.scale', self.action.scale),
        ):
            for joint in self.joints:
                if joint not in values:
                    raise InputError(f'{name} lacks {joint!r}')

    def content(self) -> dict[str, Any]:
        """Return keys and values as policy.yaml holds them."""
        found: dict[str, Any] = asdict(self)  # type: ignore[call-overload]
        found['observation'] = self.observation.content()
        return found

    def ordered(self, values: Mapping[str, float]) -> Floats:
        """Return values by joint in the policy's order [12]."""
        return np.array([values[joint] for joint in self.joints])

    def checked(self, tensors: Tensors) -> dict[str, Singles]:
        """Return the network's weights by name as float32.

        InputError for one that is missing, unknown, of another shape or not finite.
        """
        shapes = self.network.shapes(self.observation.size, len(self.joints))
        return checked_tensors(tensors, shapes, WEIGHTS)


def write_folder(folder: Path, contract: Contract, tensors: Tensors) -> None:
    """Write a policy, each file whole or not at all; InputError if tensors do not fit."""
    arrays = contract.checked(tensors)
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / WEIGHTS, save(arrays))
    write_whole(folder / CARD, dump_yaml(contract.content()))


def read_folder(folder: Path) -> tuple[Contract, dict[str, Singles]]:
    """Read contract and tensors by name; InputError of one line names folder and entry."""
    contract = read(Contract, folder / CARD, 'policy')
    weights = read_tensors(folder / WEIGHTS, 'policy')
    try:
        return contract, contract.checked(weights.tensors)
    except InputError as error:
        raise InputError(f'policy {folder}: {error}') from None
