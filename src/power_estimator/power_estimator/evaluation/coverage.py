"""How often the measured power lies in the interval around the estimate."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from power_estimator.drive_types import DriveType, assign
from power_estimator.evaluation.comparison import Evaluation, PowerComparison
from power_estimator.evaluation.scores import Score
from power_estimator.network.ppn import PowerPredictionNetwork

Floats = NDArray[np.float32]


def with_coverage(
    evaluation: Evaluation,
    comparison: PowerComparison,
    name: str,
    network: PowerPredictionNetwork,
    types: Sequence[DriveType],
) -> Evaluation:
    """The evaluation of a network with coverage and width of its intervals, if it has any."""
    estimated, measured = comparison.estimated[name], comparison.measured
    low, high = network.interval(estimated, comparison.names)

    def covered(score: Score, columns: Sequence[int]) -> Score:
        known = np.isfinite(measured[:, columns]) & np.isfinite(low[:, columns])
        if not known.any():
            return score
        y, a, b = (values[:, columns][known] for values in (measured, low, high))
        inside = float(np.mean((a <= y) & (y <= b)))
        return replace(score, coverage=inside, interval_w=float(np.mean(b - a)))

    columns = assign(comparison.names, types)
    return replace(
        evaluation,
        drives={
            drive: covered(score, [comparison.names.index(drive)])
            for drive, score in evaluation.drives.items()
        },
        types={kind: covered(score, columns[kind]) for kind, score in evaluation.types.items()},
    )
