"""What a power model is, and how it is found by name or file."""

from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from power_recordings.alignment.dataset import AlignedDataset
from wattwalk_core.errors import InputError

from power_estimator.proxies import PROXIES, Proxy


class PowerModel(Protocol):
    """Anything that turns aligned signals into watts per drive."""

    @property
    def name(self) -> str:
        """How tables, pictures and messages call the model."""

    def predict(self, data: AlignedDataset) -> NDArray[np.float32]:
        """Electrical power in W [T, D] on the grid of data; NaN where the model cannot tell."""


def load_model(spec: str) -> PowerModel:
    """
    Find a power model: `ppn:FILE_OR_RUN`, a proxy (`torque_squared`) or a `*.yaml` of effects.

    InputError names what is missing or wrong.
    """
    kind, colon, rest = spec.partition(':')
    if colon and kind == 'ppn':
        from power_estimator.network.ppn import PowerPredictionNetwork

        if not rest:
            raise InputError(f'model {spec!r}: give a run folder or a file, ppn:runs/first')
        return PowerPredictionNetwork.load(Path(rest))
    if spec in PROXIES:
        return Proxy(spec)
    if spec.endswith(('.yaml', '.yml')):
        path = Path(spec)
        if not path.is_file():
            raise InputError(f'model {spec!r}: there is no such file')
        from power_estimator.effects.model_file.model import EffectModel

        return EffectModel.load(path)
    raise InputError(
        f'model {spec!r} is not known; give ppn:RUN, a file that ends in .yaml, or one of '
        f'{", ".join(PROXIES)}'
    )
