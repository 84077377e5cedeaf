"""The sum of all drives and the electronics against the robot's supply (Fig. 3, bottom)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from power_daq.recording.aligned import AlignedDataset

from power_estimator.evaluation import RATE
from power_estimator.model import PowerModel
from power_estimator.scores import Score, block_means, score

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class WholeRobot:
    """Power at the supply and what models make of it, at 50 Hz."""

    supply: Floats  # W [N]
    estimated: Mapping[str, Floats]  # W [N], by model; drives and electronics
    electronics: Mapping[str, float]  # W, by model
    drives: int  # in the sum

    def scores(self) -> dict[str, Score]:
        """Score of each model against the supply."""
        return {name: score(self.supply, p, RATE) for name, p in self.estimated.items()}


def whole_robot(
    models: Sequence[PowerModel], test: AlignedDataset, training: AlignedDataset
) -> WholeRobot | None:
    """
    Sum the estimates of all drives; None if the supply or a drive's signals are missing.

    What the electronics draw is a constant from the training rows: the supply less the measured
    drives where all of them were measured, else less the estimated ones.
    """
    if not (np.isfinite(test.supply).any() and np.isfinite(training.supply).any()):
        return None
    block = max(1, round(test.rate / RATE))
    stretches = list(test.segments())
    complete = set(training.measured_drives()) == set(training.names)
    estimated, electronics = {}, {}
    for model in models:
        drawn = training.power if complete else model.predict(training)
        rest = training.supply - drawn.sum(axis=1)
        watts = model.predict(test).sum(axis=1)
        if not (np.isfinite(rest).any() and np.isfinite(watts).any()):
            continue
        electronics[model.name] = float(np.nanmean(rest, dtype=float))
        estimated[model.name] = block_means(watts, stretches, block) + np.float32(
            electronics[model.name]
        )
    if not estimated:
        return None
    supply = block_means(test.supply, stretches, block)
    return WholeRobot(supply, estimated, electronics, len(test.names))
