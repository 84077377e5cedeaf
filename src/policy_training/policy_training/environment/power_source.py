"""Source of the watts that training puts into the reward: a power model, or the plant itself."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from power_estimator.batch.power import BatchPower
from sim_bridge.plant.circuit import Circuit
from sim_bridge.plant.parameters import Plant
from wattwalk_core.anymal import JOINT_NAMES
from wattwalk_core.arrays import Floats

from policy_training.config import TrainingConfig
from policy_training.environment.robots import Substep

_JOINTS: Final = len(JOINT_NAMES)


class PlantPower:
    """Watts of the drives of N robots, from the air-gap torque and rotor speed of each time step.

    The circuit of `sim_bridge` with windings at the plant's initial temperature and the bus at
    its nominal voltage. It sees what no robot measures: an estimate in a reward can at best be as
    good.
    """

    def __init__(self, plant: Plant, robots: int, timestep: float) -> None:
        names = JOINT_NAMES * robots
        drives = {name: np.tile(x, robots) for name, x in plant.resolve(JOINT_NAMES).items()}
        self._circuit = Circuit(plant, names, drives)
        self._line: Floats = drives['line_resistance'] * plant.effects.line_resistance.scale
        self._voltage = plant.supply.voltage
        self._timestep = timestep
        self._time = 0.0

    def reset(self, ids: NDArray[np.intp]) -> None:
        """Do nothing: the circuit has no past."""

    def drives(self, substeps: Sequence[Substep]) -> Floats:
        """Return mean watts at the meter over the time steps of a policy step [N, 12]."""
        motor = np.stack([step.motor.ravel() for step in substeps])
        speed = np.stack([step.rotor_speed.ravel() for step in substeps])
        time: Floats = self._time + self._timestep * np.arange(1.0, len(substeps) + 1.0)
        self._time = float(time[-1])
        link = self._circuit.solve(motor, speed, np.zeros_like(motor), self._voltage, time).link
        power = link + self._line * np.square(link / self._voltage)
        return np.asarray(power.mean(axis=0).reshape(-1, _JOINTS))


PLANT: Final = 'plant'  # in place of a model: what the plant's own circuit draws


class PredictedPower:
    """Power of the drives by a model, W; 0 during the model's warm-up."""

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


PowerSource = PlantPower | PredictedPower  # watts of each drive of N robots


def power_source(config: TrainingConfig) -> PowerSource | None:
    """Return the power source that a config names; None without one, InputError for a bad name."""
    spec, physics = config.power.model, config.physics
    if not spec:
        return None
    if spec == PLANT:
        return PlantPower(Plant.load(physics.plant), physics.environments, physics.timestep)
    return PredictedPower.load(spec, physics.environments)
