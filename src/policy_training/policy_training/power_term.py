"""Predicted power inside the training loop: any power model, one instance per drive."""

from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from power_daq.cli import InputError
from power_daq.recording.aligned import AlignedDataset
from power_estimator.drive_types import assign
from power_estimator.lstm import LstmBank
from power_estimator.model import PowerModel, load_model
from power_estimator.ppn import PowerPredictionNetwork
from sim_bridge.robot import JOINT_NAMES

Floats = NDArray[np.float64]
_RATE = 200.0  # Hz
_VOLTAGE = 48.0  # V
_TEMPERATURE = 40.0  # °C


class BatchPower(Protocol):
    """Watts of all drives of N robots, sample by sample at 200 Hz."""

    def reset(self, robots: NDArray[np.intp]) -> None:
        """Forget the past of some robots."""

    def step(self, position_error: Floats, torque: Floats, velocity: Floats) -> Floats:
        """One sample of rad, N·m, rad/s [N, 12] → W [N, 12]."""


class CarriedNetwork:
    """The Power Prediction Network with carried state."""

    def __init__(self, network: PowerPredictionNetwork, robots: int) -> None:
        self._robots = robots
        drives = JOINT_NAMES * robots
        columns = assign(drives, network.types)
        if sum(map(len, columns.values())) != len(drives):
            raise InputError(f'{network.name} does not know every drive of {JOINT_NAMES}')
        networks = {n.type.name: (n.weights, n.scaling) for n in network.checkpoint.networks}
        self._bank = LstmBank(networks, columns, len(drives))
        self._features = np.empty((len(drives), 3), np.float32)

    def reset(self, robots: NDArray[np.intp]) -> None:
        """Forget the past of some robots."""
        marked = np.zeros(self._robots, bool)
        marked[robots] = True
        self._bank.reset(np.repeat(marked, len(JOINT_NAMES)))

    def step(self, position_error: Floats, torque: Floats, velocity: Floats) -> Floats:
        """One sample of rad, N·m, rad/s [N, 12] → W [N, 12]."""
        for column, values in enumerate((position_error, torque, velocity)):
            self._features[:, column] = values.ravel()
        return self._bank.step(self._features).reshape(self._robots, -1).astype(np.float64)


class Windowed:
    """
    Any power model, which sees the last samples of each drive anew at every step.

    The paper's form for a network (a window of history and a state of zero), and the way to use a
    model of named effects.
    """

    def __init__(
        self, predict: Callable[[AlignedDataset], NDArray[np.float32]], robots: int, history: int
    ) -> None:
        self._predict = predict
        self._robots = robots
        shape = (history, robots, len(JOINT_NAMES))
        self._error, self._torque, self._velocity = (np.zeros(shape, np.float32) for _ in range(3))

    def reset(self, robots: NDArray[np.intp]) -> None:
        """Forget the past of some robots: they were at rest."""
        for past in (self._error, self._torque, self._velocity):
            past[:, robots] = 0.0

    def step(self, position_error: Floats, torque: Floats, velocity: Floats) -> Floats:
        """One sample of rad, N·m, rad/s [N, 12] → W [N, 12]."""
        for past, values in (
            (self._error, position_error),
            (self._torque, torque),
            (self._velocity, velocity),
        ):
            past[:-1] = past[1:]
            past[-1] = values
        power = self._predict(self._dataset())
        return power[-1].reshape(self._robots, -1).astype(np.float64)

    def _dataset(self) -> AlignedDataset:
        history = len(self._error)
        shape = (history, self._robots * len(JOINT_NAMES))
        velocity = self._velocity.reshape(shape)
        position = np.cumsum(velocity, axis=0) / np.float32(_RATE)
        missing = np.full(shape, np.nan, np.float32)
        return AlignedDataset(
            rate=_RATE,
            names=JOINT_NAMES * self._robots,
            time=np.arange(history) / _RATE,
            segment=np.zeros(history, np.int32),
            position=position,
            velocity=velocity,
            torque=self._torque.reshape(shape),
            command=position + self._error.reshape(shape),
            power=missing,
            voltage=np.full(shape, _VOLTAGE, np.float32),
            current=missing,
            temperature=np.full(shape, _TEMPERATURE, np.float32),
            supply=missing[:, 0],
            recordings=('training',),
            recording=np.zeros(history, np.int32),
        )


def load_power(spec: str, robots: int) -> BatchPower:
    """
    A power model for N robots: `ppn:FILE_OR_RUN`, a file of named effects, or a proxy.

    InputError where there is no such model.
    """
    model: PowerModel = load_model(spec)
    if isinstance(model, PowerPredictionNetwork):
        return CarriedNetwork(model, robots)
    return Windowed(model.predict, robots, history=4)


def paper_form(run: Path, robots: int) -> BatchPower:
    """The network as the paper runs it: 0.3 s of history at each sample."""
    network = PowerPredictionNetwork.load(run)
    return Windowed(network.predict, robots, network.checkpoint.config.history)
