"""Stretch of held-out data for the figure after Fig. 3."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from wattwalk_core.arrays import Floats

from power_estimator.effects.signals.reducer import REDUCED_RATE
from power_estimator.judge.judge import Judge
from power_estimator.judge.result import JudgedModel, SupplyScore

SHOWN = ('torque_squared', 'mechanical_power', 'acceleration_squared')
LONGEST = 4.0  # s


@dataclass(frozen=True)
class Traces:
    """Held-out traces at 50 Hz: of a drive, and of the whole robot where it was measured."""

    time: Floats  # s [N]
    drive: str
    measured: Floats  # W [N]
    estimated: Floats  # W [N]
    r2: float  # of the drive, over all held-out data
    proxies: Mapping[str, Floats] = field(default_factory=dict)  # W [N], by name
    supply: SupplyScore | None = None  # score over all held-out data, traces [N]


def traces(judge: Judge, judged: Sequence[JudgedModel]) -> Traces:
    """Return at most 4 s of the drive whose power varies most; judged[0] is the network shown.

    They are of the longest stretch or, among stretches of about the same length, of the one in
    which that drive varies most.
    """
    model = judged[0]
    supply = model.supply
    measured = np.where(model.rows, model.measured, np.nan)
    column = int(np.argmax(np.nan_to_num(np.nanstd(measured, axis=0))))
    rows = _stretch(judge.prepared.reducer.stretches(), measured[:, column])
    drive = judge.prepared.names[column]
    if supply is not None:
        supply = replace(supply, measured=supply.measured[rows], estimated=supply.estimated[rows])
    return Traces(
        time=judge.prepared.time[rows],
        drive=drive,
        measured=measured[rows, column],
        estimated=model.estimated[rows, column],
        r2=model.drives[drive].r2,
        proxies={
            other.name: other.estimated[rows, column] for other in judged if other.name in SHOWN
        },
        supply=supply,
    )


def _stretch(gap_free: Sequence[slice], power: Floats) -> slice:
    runs = []
    for within in gap_free:
        known = np.r_[False, np.isfinite(power[within]), False]
        edges = within.start + np.flatnonzero(np.diff(known))
        runs += [slice(start, stop) for start, stop in edges.reshape(-1, 2).tolist()]
    longest = max(run.stop - run.start for run in runs)
    long = [run for run in runs if run.stop - run.start >= 0.9 * longest]
    best = max(long, key=lambda run: float(np.std(power[run])))
    return slice(best.start, min(best.stop, best.start + round(LONGEST * REDUCED_RATE)))
