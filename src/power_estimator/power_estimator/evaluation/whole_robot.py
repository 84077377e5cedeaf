"""Sum of all drives and the electronics against the robot's supply (Fig. 3, bottom)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from power_recordings.alignment.dataset import AlignedDataset

from power_estimator.evaluation.comparison import RATE
from power_estimator.evaluation.scores import Score, block_means, score
from power_estimator.model import PowerModel

Floats = NDArray[np.float32]
LAGS = 0.05  # s, the longest lag of a supply's readings that is looked for


@dataclass(frozen=True)
class WholeRobot:
    """Power at the supply, measured and estimated, at 50 Hz."""

    supply: Floats  # W [N], brought forward by lag
    estimated: Mapping[str, Floats]  # W [N], by model; drives and electronics
    electronics: Mapping[str, float]  # W, by model
    drives: int  # in the sum
    lag: float  # s by which the supply's readings come late

    def scores(self) -> dict[str, Score]:
        """Score each model against the supply."""
        return {name: score(self.supply, p, RATE) for name, p in self.estimated.items()}


def whole_robot(
    models: Sequence[PowerModel], test: AlignedDataset, training: AlignedDataset
) -> WholeRobot | None:
    """
    Sum the estimates of all drives; None if the supply or a drive's signals are missing.

    Two constants come from the training rows: the power of the electronics (supply less the
    measured drives if all were measured, else less the estimated ones) and the lag of the supply's
    readings, which may be means of the time before their stamps.
    """
    block = max(1, round(test.rate / RATE))
    complete = set(training.measured_drives()) == set(training.names)
    estimated, electronics, lag = {}, {}, None
    for model in models:
        drawn = (training.power if complete else model.predict(training)).sum(axis=1)
        watts = model.predict(test).sum(axis=1)
        if lag is None:
            lag = _lag(training, drawn)
        rest = shifted(training.supply, training, lag) - drawn
        if not (np.isfinite(rest).any() and np.isfinite(watts).any()):
            continue
        electronics[model.name] = float(np.nanmean(rest, dtype=float))
        estimated[model.name] = block_means(watts, test.segments(), block) + np.float32(
            electronics[model.name]
        )
    if lag is None or not estimated:
        return None
    supply = block_means(shifted(test.supply, test, lag), test.segments(), block)
    if not np.isfinite(supply).any():
        return None
    return WholeRobot(supply, estimated, electronics, len(test.names), lag / test.rate)


def shifted(values: Floats, data: AlignedDataset, samples: int) -> Floats:
    """Shift values [T] forward by a number of samples in each segment; NaN at its end."""
    result = np.full_like(values, np.nan)
    for run in data.segments():
        if run.stop - run.start > samples:
            result[run.start : run.stop - samples] = values[run.start + samples : run.stop]
    return result


def _lag(data: AlignedDataset, drawn: Floats) -> int:
    def spread(samples: int) -> float:
        rest = shifted(data.supply, data, samples) - drawn
        return float(np.nanvar(rest)) if np.isfinite(rest).any() else np.inf

    return min(range(round(LAGS * data.rate) + 1), key=spread)
