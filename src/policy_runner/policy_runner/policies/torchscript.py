"""Policies as TorchScript files, whose contract is a YAML file beside them."""

import warnings
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray
from wattwalk_core.errors import InputError

from policy_runner.policies.folder import CARD, Contract
from policy_runner.policies.learned import LearnedPolicy

SUFFIXES = ('.pt', '.pth', '.jit', '.ts')


def load_torchscript(file: Path) -> LearnedPolicy:
    """
    A scripted or traced module from observation [1, size] to action [1, 12].

    NAME.yaml or policy.yaml beside NAME.pt holds the contract as in a policy folder, without
    `network`. InputError says what is missing or wrong.
    """
    beside = [file.with_suffix('.yaml'), file.with_name(CARD)]
    card = next((path for path in beside if path.is_file()), None)
    if card is None:
        raise InputError(f'policy {file}: its contract {beside[0].name} is missing beside it')
    try:
        content = yaml.safe_load(card.read_text(encoding='utf-8'))
        if isinstance(content, dict):
            content.setdefault('network', {'hidden': []})
        contract = Contract.parse(content)
        network = _TorchNetwork(file, contract)
    except InputError as error:
        raise InputError(f'policy {file}: {error}') from None
    except (OSError, yaml.YAMLError, UnicodeDecodeError) as error:
        line = ' '.join(str(error).split())
        raise InputError(f'policy {file}: {card.name} cannot be read: {line}') from error
    return LearnedPolicy(contract, network)


class _TorchNetwork:
    def __init__(self, file: Path, contract: Contract) -> None:
        import torch

        torch.set_num_threads(1)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter('ignore', DeprecationWarning)
                module = torch.jit.load(str(file), map_location='cpu')
            answer = module.eval()(torch.zeros(1, contract.observation.size))
        except (RuntimeError, ValueError) as error:
            line = str(error).strip().split('\n')[-1]
            raise InputError(f'is no TorchScript that takes this observation: {line}') from error
        if tuple(answer.shape) != (1, 12) or not bool(torch.isfinite(answer).all()):
            raise InputError(
                f'its output has shape {list(answer.shape)}; it must be [1, 12] and finite'
            )
        self._module, self._torch = module, torch

    def __call__(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        torch = self._torch
        with torch.inference_mode():
            action = self._module(torch.from_numpy(observation[None]))
        return np.asarray(action[0].numpy())
