"""Coverage of the intervals around estimates of power."""

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
    """Add coverage and width of a network's intervals, if it has any, to its evaluation."""
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
