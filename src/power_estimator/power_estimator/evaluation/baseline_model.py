"""Baseline model that networks are compared with: shaft + copper loss + idle."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from power_recordings.alignment.dataset import AlignedDataset
from wattwalk_core.errors import InputError

from power_estimator.drive_types import DriveType, assign
from power_estimator.effects import builtin_catalogue
from power_estimator.effects.fit.design import Active
from power_estimator.effects.fit.training import fit_model, material
from power_estimator.effects.model_file.model import EffectModel
from power_estimator.effects.needs import RATE
from power_estimator.model import Needs

BASELINE: Final = 'plain'
EFFECTS: Final = ('shaft', 'copper_loss', 'idle')


@dataclass(frozen=True)
class BaselineModel:
    """
    Mechanical power, a loss by torque² and a constant draw, fitted per drive type.

    It is the base model of the lab (`ros2 run power_lab fit --effects shaft,copper_loss,idle`),
    fitted here on the training part that networks and proxies have.
    """

    name: str = BASELINE
    models: tuple[EffectModel, ...] = ()  # one a drive type

    @property
    def needs(self) -> Needs:
        """Torque and speed as measured."""
        return Needs(dict.fromkeys(('torque', 'velocity'), ''), RATE, smooth=False)

    def fit(self, data: AlignedDataset, types: Sequence[DriveType]) -> 'BaselineModel':
        """Return the model fitted to data; InputError if a type moves too little or too short."""
        catalogue = builtin_catalogue()
        active = [Active.of(catalogue[name]) for name in EFFECTS]
        models = []
        for columns in assign(data.names, types).values():
            known = [c for c in columns if np.isfinite(data.power[:, c]).any()]
            if not known:
                continue
            measured = np.asarray(np.isfinite(data.power[:, known]).any(axis=1), np.bool_)
            rows = data.drives([data.names[c] for c in known]).rows(measured)
            models.append(fit_model(BASELINE, material(rows), active, catalogue)[0])
        if not models:
            raise InputError(f'{BASELINE}: no drive has measured power to be fitted to')
        return BaselineModel(self.name, tuple(models))

    def predict(self, data: AlignedDataset) -> NDArray[np.float32]:
        """Return the electrical power in W [T, D]; NaN for drives that it was not fitted to."""
        result = np.full(data.torque.shape, np.nan, np.float32)
        for model in self.models:
            power = model.predict(data)
            result = np.where(np.isfinite(power), power, result)
        return result
