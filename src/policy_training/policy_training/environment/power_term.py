"""
Predicted power as a reward: one instance of a power model for each drive of N robots.

Training uses `power_estimator.batch.power.BatchPower`, whose state is carried from step to step.
The form of the paper, which looks at a window of history anew each time, is here to compare costs.
"""

from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray
from power_estimator.batch.power import BatchPower
from power_estimator.network.ppn import PowerPredictionNetwork
from power_recordings.alignment.dataset import AlignedDataset
from wattwalk_core.anymal import JOINT_NAMES

from policy_training.environment.robots import Substep

Floats = NDArray[np.float32]

RATE: Final = 200.0  # Hz, of the samples that models take
_VOLTAGE: Final = 48.0  # V
_TEMPERATURE: Final = 40.0  # °C


class PowerModel(Protocol):
    """Mean watts of all drives of N robots over a step of the policy."""

    @property
    def ready(self) -> NDArray[np.bool_]:
        """Whose estimate may be relied on [N]."""

    def reset(self, ids: NDArray[np.intp]) -> None:
        """Forget the past of some robots."""

    def step(self, position_error: Floats, torque: Floats, speed: Floats) -> Any:
        """The next S samples of rad, N·m and rad/s [N, S, 12] → mean W [N, 12]."""


def load_power(spec: str, robots: int) -> PowerModel:
    """A model by `ppn:FILE_OR_RUN`, file or name for N robots; InputError if there is none."""
    return BatchPower.load(spec, JOINT_NAMES, robots)


def predict_step(model: PowerModel, substeps: list[Substep]) -> Floats:
    """Mean watts [N, 12] of the samples of one step; 0 where the model cannot tell yet."""
    error, torque, speed = (
        np.stack([getattr(substep, name) for substep in substeps], axis=1, dtype=np.float32)
        for name in ('position_error', 'torque', 'velocity')
    )
    watts: Floats = model.step(error, torque, speed)
    return np.nan_to_num(watts) * model.ready[:, None]


class WindowedNetwork:
    """The network as the paper runs it: 0.3 s of history at each sample, a state of zero."""

    def __init__(self, run: Path, robots: int) -> None:
        self._network = PowerPredictionNetwork.load(run)
        self._robots = robots
        history = self._network.checkpoint.config.history
        self._past = np.zeros((3, history, robots * len(JOINT_NAMES)), np.float32)

    @property
    def ready(self) -> NDArray[np.bool_]:
        """All: what came before a start counts as rest."""
        return np.ones(self._robots, bool)

    def reset(self, ids: NDArray[np.intp]) -> None:
        """Forget the past of some robots: they were at rest."""
        whole = self._past.reshape(3, -1, self._robots, len(JOINT_NAMES))
        whole[:, :, ids] = 0.0

    def step(self, position_error: Floats, torque: Floats, speed: Floats) -> Floats:
        """The next S samples of rad, N·m and rad/s [N, S, 12] → mean W [N, 12]."""
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
            voltage=_VOLTAGE,
            temperature=_TEMPERATURE,
        )
