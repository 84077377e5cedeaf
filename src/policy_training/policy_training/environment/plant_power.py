"""Electrical power of the simulated robots by the plant's own circuit, as a ceiling for models."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray
from sim_bridge.plant.circuit import Circuit
from sim_bridge.plant.parameters import Plant
from wattwalk_core.anymal import JOINT_NAMES

from policy_training.environment.robots import Substep

Floats = NDArray[np.float64]

_JOINTS: Final = len(JOINT_NAMES)


class PlantPower:
    """
    Watts of the drives of N robots, from the air-gap torque and rotor speed of each time step.

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
