"""Stretch of held-out data for the figure after Fig. 3."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from power_estimator.evaluation.comparison import RATE, PowerComparison
from power_estimator.evaluation.whole_robot import WholeRobot

Floats = NDArray[np.float32]
SHOWN = ('torque_squared', 'mechanical_power', 'acceleration_squared')
LONGEST = 4.0  # s


@dataclass(frozen=True)
class Traces:
    """A stretch of held-out data at 50 Hz: a drive, and the whole robot where it was measured."""

    time: NDArray[np.float64]  # s [N]
    drive: str
    measured: Floats  # W [N]
    estimated: Floats  # W [N]
    r2: float  # of the drive, over all held-out data
    proxies: Mapping[str, Floats] = field(default_factory=dict)  # W [N], by name
    supply: Floats | None = None  # W [N], whole robot
    robot: Floats | None = None  # W [N], sum of the estimates and the electronics
    electronics: float = float('nan')  # W
    drives: int = 0  # in the sum
    robot_r2: float = float('nan')  # over all held-out data


def traces(
    comparison: PowerComparison,
    r2: Mapping[str, float],
    robot: WholeRobot | None = None,
    model: str = 'ppn',
) -> Traces:
    """
    Choose the drive whose power varies most, in the longest stretch.

    Among stretches of about the same length it is the one in which that drive varies most; at most
    4 s of it are shown.
    """
    spread = np.nan_to_num(np.nanstd(comparison.measured, axis=0))
    column = int(np.argmax(spread))
    rows = _stretch(comparison.segment, comparison.measured[:, column])
    drive = comparison.names[column]
    found = Traces(
        time=comparison.time[rows],
        drive=drive,
        measured=comparison.measured[rows, column],
        estimated=comparison.estimated[model][rows, column],
        r2=r2.get(drive, float('nan')),
        proxies={
            name: comparison.estimated[name][rows, column]
            for name in SHOWN
            if name in comparison.estimated
        },
    )
    if robot is None or model not in robot.estimated:
        return found
    return Traces(
        **{
            **vars(found),
            'supply': robot.supply[rows],
            'robot': robot.estimated[model][rows],
            'electronics': robot.electronics[model],
            'drives': robot.drives,
            'robot_r2': robot.scores()[model].r2,
        }
    )


def _stretch(segment: NDArray[np.intp], power: Floats) -> slice:
    edges = np.flatnonzero(np.diff(segment)) + 1
    borders = [0, *edges.tolist(), len(segment)]
    stretches = [slice(a, b) for a, b in pairwise(borders)]
    longest = max(s.stop - s.start for s in stretches)
    long = [s for s in stretches if s.stop - s.start >= 0.9 * longest]
    best = max(long, key=lambda s: float(np.nan_to_num(np.nanstd(power[s]))))
    return slice(best.start, min(best.stop, best.start + round(LONGEST * RATE)))
