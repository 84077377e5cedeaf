"""The network in the paper's windowed form, whose cost in a reward is compared."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from power_estimator.network.ppn import PowerPredictionNetwork
from power_recordings.alignment.dataset import AlignedDataset
from wattwalk_core.anymal import JOINT_NAMES

Floats = NDArray[np.float32]
RATE = 200.0  # Hz


class WindowedNetwork:
    """A network for N robots that runs 0.3 s of history from a state of zero at each sample."""

    def __init__(self, run: Path, robots: int) -> None:
        self._network = PowerPredictionNetwork.load(run)
        self._robots = robots
        history = self._network.checkpoint.config.history
        self._past = np.zeros((3, history, robots * len(JOINT_NAMES)), np.float32)
        self.ready = np.ones(robots, bool)  # the time before a start counts as rest

    def step(self, position_error: Floats, torque: Floats, speed: Floats) -> Floats:
        """Return mean W [N, 12] of the next S samples of rad, N·m and rad/s [N, S, 12]."""
        watts = []
        for index in range(position_error.shape[1]):
            self._past[:, :-1] = self._past[:, 1:]
            for place, values in enumerate((position_error, torque, speed)):
                self._past[place, -1] = values[:, index].ravel()
            watts.append(self._network.predict(self._dataset())[-1])
        return np.mean(watts, axis=0, dtype=np.float32).reshape(self._robots, -1)

    def _dataset(self) -> AlignedDataset:
        error, torque, velocity = self._past
        return AlignedDataset.blank(
            RATE,
            JOINT_NAMES * self._robots,
            np.arange(len(error)) / RATE,
            'training',
            position=0.0,
            velocity=velocity,
            torque=torque,
            command=error,
        )
