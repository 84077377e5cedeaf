"""Predicted power as a reward: one instance of a power model for each drive of N robots."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from power_estimator.batch.power import BatchPower
from wattwalk_core.anymal import JOINT_NAMES

from policy_training.environment.robots import Substep

Floats = NDArray[np.float32]


def load_power(spec: str, robots: int) -> BatchPower:
    """Load a model by `ppn:FILE_OR_RUN`, file or name for N robots; InputError without one."""
    return BatchPower.load(spec, JOINT_NAMES, robots)


def predict_step(model: BatchPower, substeps: Sequence[Substep]) -> Floats:
    """Return mean watts [N, 12] of the samples of one step; 0 during the model's warm-up."""
    error, torque, speed = (
        np.stack([getattr(substep, name) for substep in substeps], axis=1, dtype=np.float32)
        for name in ('position_error', 'torque', 'velocity')
    )
    return np.nan_to_num(model.step(error, torque, speed)) * model.ready[:, None]
