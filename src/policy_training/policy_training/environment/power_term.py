"""Watts of the simulated robots as a reward, from a power model or from the plant itself."""

from collections.abc import Sequence
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray
from power_estimator.batch.power import BatchPower
from sim_bridge.plant.parameters import Plant
from wattwalk_core.anymal import JOINT_NAMES

from policy_training.config import TrainingConfig
from policy_training.environment.plant_power import PlantPower
from policy_training.environment.robots import Substep

PLANT: Final = 'plant'
"""In place of a model: what the plant's own circuit draws."""


class PowerSource(Protocol):
    """Watts per drive of N robots."""

    def reset(self, ids: NDArray[np.intp]) -> None:
        """Forget the past of the robots of these indices."""

    def drives(self, substeps: Sequence[Substep]) -> NDArray[Any]:
        """Return mean watts [N, 12] over the time steps of a policy step."""


class PredictedPower:
    """Power by a model, with one instance of it for each drive; 0 W during its warm-up."""

    def __init__(self, model: BatchPower) -> None:
        self._model = model

    @classmethod
    def load(cls, spec: str, robots: int) -> 'PredictedPower':
        """Load a model by `ppn:FILE_OR_RUN`, file or name; InputError without one."""
        return cls(BatchPower.load(spec, JOINT_NAMES, robots))

    def reset(self, ids: NDArray[np.intp]) -> None:
        """Forget the past of the robots of these indices."""
        self._model.reset(ids)

    def drives(self, substeps: Sequence[Substep]) -> NDArray[Any]:
        """Return mean watts [N, 12] over the time steps of a policy step."""
        error, torque, speed = (
            np.stack([getattr(substep, name) for substep in substeps], axis=1, dtype=np.float32)
            for name in ('position_error', 'torque', 'velocity')
        )
        model = self._model
        return np.nan_to_num(model.step(error, torque, speed)) * model.ready[:, None]


def power_source(config: TrainingConfig) -> PowerSource | None:
    """Return what tells a config's robots their watts; None without a power term."""
    spec, physics = config.power.model, config.physics
    if not spec:
        return None
    if spec == PLANT:
        return PlantPower(Plant.load(physics.plant), physics.environments, physics.timestep)
    return PredictedPower.load(spec, physics.environments)
