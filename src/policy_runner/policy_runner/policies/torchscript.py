"""TorchScript policies, each with its contract in a YAML file beside it."""

import io
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np
import torch
from torch import nn
from wattwalk_core.arrays import Singles
from wattwalk_core.errors import InputError
from wattwalk_core.files import read_bytes, together, write_whole
from wattwalk_core.schema import parse
from wattwalk_core.tensors import SIZE
from wattwalk_core.yaml_file import dump_yaml, read_yaml

from policy_runner.policies.folder import CARD, Contract, read_folder
from policy_runner.policies.learned import LearnedPolicy, Network

_ACTIVATIONS: Final = {'elu': nn.ELU, 'relu': nn.ReLU, 'tanh': nn.Tanh}


def torch_network(contract: Contract, tensors: Mapping[str, Singles]) -> nn.Module:
    """Return the network of a policy folder, [N, size] → [N, 12]."""
    layers: list[nn.Module] = []
    for index in range(len(contract.network.hidden) + 1):
        weight, bias = (
            torch.from_numpy(tensors[f'layer{index}.{part}']) for part in ('weight', 'bias')
        )
        linear = nn.Linear(weight.shape[1], weight.shape[0])
        linear.load_state_dict({'weight': weight, 'bias': bias})
        layers += [linear, _ACTIVATIONS[contract.network.activation]()]
    return nn.Sequential(*layers[:-1]).requires_grad_(False)


SUFFIXES = ('.pt', '.pth', '.jit', '.ts')


def load_torchscript(file: Path, *, trust_code: bool = False) -> LearnedPolicy:
    """Load a scripted or traced module from observation [1, size] to action [1, 12].

    NAME.yaml or policy.yaml beside NAME.pt holds the contract as in a policy folder, without
    `network`. Raises InputError, which names the file and the entry, and without trust_code.
    """
    if not trust_code:
        raise InputError(
            f'policy {file}: TorchScript is code that may do anything here; give --trust-code if '
            'you trust its author, or a policy folder of weights and contract, which runs no code'
        )
    beside = [file.with_suffix('.yaml'), file.with_name(CARD)]
    card = next((path for path in beside if path.is_file()), None)
    if card is None:
        raise InputError(f'policy {file}: its contract {beside[0].name} is missing beside it')
    content = read_yaml(card, 'policy')
    if isinstance(content, dict):
        content.setdefault('network', {'hidden': []})
    contract = parse(Contract, content, f'policy {card}')
    return LearnedPolicy(contract, _torchscript_network(file, contract))


def write_torchscript(folder: Path, file: Path) -> Path:
    """Write a policy's network as TorchScript [N, size] → [N, 12]; return the contract's path.

    The contract NAME.yaml beside NAME.pt says how observations are made and what actions mean.
    InputError names what is wrong in the folder.
    """
    contract, tensors = read_folder(folder)
    module = torch_network(contract, tensors)
    stream = io.BytesIO()
    with warnings.catch_warnings(action='ignore', category=DeprecationWarning):
        torch.jit.save(torch.jit.script(module), stream)
    beside = file.with_suffix('.yaml')
    with together():
        write_whole(file, stream.getvalue())
        write_whole(beside, dump_yaml(contract.content()))
    return beside


def _torchscript_network(file: Path, contract: Contract) -> Network:
    torch.set_num_threads(1)
    data = io.BytesIO(read_bytes(file, 'policy', SIZE))
    try:
        with warnings.catch_warnings(action='ignore', category=DeprecationWarning):
            module = torch.jit.load(data, map_location='cpu')
        answer = module.eval()(torch.zeros(1, contract.observation.size))
        sound = tuple(answer.shape) == (1, 12) and bool(torch.isfinite(answer).all())
    except Exception as error:  # code of others may raise anything
        line = str(error).strip().split('\n')[-1]
        raise InputError(
            f'policy {file}: no TorchScript module that takes this observation: {line}'
        ) from error
    if not sound:
        raise InputError(
            f'policy {file}: its output has shape {list(answer.shape)}; expected [1, 12] and '
            'finite'
        )

    def act(observation: Singles) -> Singles:
        with torch.inference_mode():
            return np.asarray(module(torch.from_numpy(observation[None]))[0].numpy())

    return act
