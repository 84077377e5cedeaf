"""Export of a network as a power term for the training of others."""

import io
import json
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import torch
from safetensors.torch import save
from wattwalk_core.errors import InputError
from wattwalk_core.files import together, write_whole

from power_estimator.network.checkpoint import Checkpoint, Network
from power_estimator.network.features import FEATURES
from power_estimator.portable import power_term

MODULE: Final = 'power_term.py'
TENSORS: Final = 'power_term.safetensors'
SCRIPT: Final = 'power_term.pt'


def export(
    checkpoint: Checkpoint, folder: Path, drives: Sequence[str], sample_rate: float
) -> list[Path]:
    """Write module and tensors of a power term into folder; return the files.

    With drives there is TorchScript too, for these columns. sample_rate: in Hz, of the samples
    that it takes. InputError for a drive of no type or a rate that is no whole part of the
    network's.
    """
    tensors = {
        f'{network.type.name}/{name}': values
        for network in checkpoint.networks
        for name, values in in_si_units(network).items()
    }
    card = {
        'format': power_term.FORMAT,
        'rate': checkpoint.config.rate,
        'warm_up': checkpoint.config.warm_up,
        'types': {n.type.name: list(n.type.patterns) for n in checkpoint.networks},
        'features': list(FEATURES),
        'recordings': [recording.name for recording in checkpoint.recordings],
    }
    files = [folder / MODULE, folder / TENSORS]
    folder.mkdir(parents=True, exist_ok=True)
    with together():
        write_whole(files[0], Path(power_term.__file__).read_bytes())
        write_whole(files[1], save(tensors, {'power_term': json.dumps(card)}))
    if drives:
        files.append(folder / SCRIPT)
        write_whole(files[2], _scripted(files[1], drives, sample_rate))
    return files


def in_si_units(network: Network) -> dict[str, torch.Tensor]:
    """Return the weights with the scaling folded in, by name: SI units in, watts out."""
    found = network.weights.in_si_units(network.scaling)
    return {name: torch.tensor(values, dtype=torch.float32) for name, values in found.items()}


def _scripted(file: Path, drives: Sequence[str], sample_rate: float) -> bytes:
    try:
        term = power_term.PowerTerm.load(file, drives, sample_rate)
    except ValueError as error:
        raise InputError(str(error)) from None
    stream = io.BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', DeprecationWarning)
        torch.jit.save(torch.jit.script(term), stream)
    return stream.getvalue()
