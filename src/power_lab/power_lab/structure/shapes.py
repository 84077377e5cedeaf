"""Smooth shapes over one driver: penalised splines beside the base model."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from power_estimator.effects.fit.design_builder import Linearisation
from power_estimator.effects.signals.prepared import Prepared
from wattwalk_core.arrays import Floats

from power_lab.structure.drivers import Family, driver_values, factor_values
from power_lab.structure.problem import DriveProblem, Moments, price

NODES, OF_TURN, OF_POSITION = 33, 97, 49
"""Nodes of a shape: over most drivers, over a turn, over a position."""
_SMOOTHING = tuple(10.0**k for k in range(-5, 3))
_AT_ONCE = 17  # columns
_TAIL = 0.002  # of the samples, beyond the outermost nodes


@dataclass(frozen=True)
class LearnedShape:
    """A shape of one family on one drive, with its held-out gain."""

    family: Family
    drive: int
    nodes: Floats  # [K], values of the driver
    share: Floats  # [K], of the samples near each node
    coefficients: Floats  # [m + K], of the base and of the shape at the nodes
    by_fold: Floats  # [F + 1, m + K]
    moments: Moments
    gain: float  # W² by row, held out

    @property
    def values(self) -> Floats:
        """The shape at its nodes [K]."""
        return self.coefficients[-len(self.nodes) :]


def hats(values: Floats, nodes: Floats) -> tuple[NDArray[np.intp], Floats]:
    """Place left of each value [T] among evenly spaced nodes, and its distance in spacings."""
    place = (values - nodes[0]) / (nodes[1] - nodes[0])
    place = np.clip(place, 0.0, len(nodes) - 1.000001)
    left = place.astype(np.intp)
    return left, place - left


def spread(values: Floats, count: int = NODES) -> Floats | None:
    """Nodes over the values, None where they hardly vary."""
    low, high = np.quantile(values, (_TAIL, 1.0 - _TAIL))
    if not np.isfinite(high - low) or high - low < 1e-9 * max(abs(low), abs(high), 1e-6):
        return None
    return np.linspace(low, high, count)


def instant(family: Family, point: Linearisation, drive: int) -> tuple[Floats, Floats]:
    """Driver [T] and what its function is multiplied by, W per unit [T]."""
    signals = point.signals
    z = driver_values(family.driver, signals, drive)
    weight = factor_values(family.factor, signals, drive) * np.ones(len(z))
    if family.acts_on == 'torque':
        weight = weight * price(point, drive)
    return z, weight


def learn(
    problem: DriveProblem, family: Family, point: Linearisation, prepared: Prepared
) -> LearnedShape | None:
    """Learn the family's shape; its smoothness is that with the least held-out error."""
    z, weight = instant(family, point, problem.drive)
    count = {'angle': OF_TURN, 'position': OF_POSITION}.get(family.driver.name, NODES)
    nodes = spread(z, count)
    if nodes is None:
        return None
    left, over = hats(z, nodes)
    share = np.bincount(left, minlength=count) / len(z)
    columns = _reduced_hats(left, over, weight, count, prepared)
    moments = problem.moments(columns)
    curvature = np.diff(np.eye(count), n=2, axis=0)
    bend = curvature.T @ curvature
    own = moments.gram[-1][-count:, -count:]
    unit = float(np.trace(own)) / count
    if unit <= 0.0:
        return None
    best: tuple[float, Floats] | None = None
    for smoothing in _SMOOTHING:
        penalty = smoothing * unit * bend + 1e-6 * unit * np.eye(count)
        solved = problem.solve(moments, penalty)
        error = float(moments.error(solved[:-1]).sum())
        if best is None or error < best[0]:
            best = (error, solved)
    assert best is not None
    return LearnedShape(
        family=family,
        drive=problem.drive,
        nodes=nodes,
        share=share,
        coefficients=best[1][-1],
        by_fold=best[1],
        moments=moments,
        gain=problem.base_error - best[0] / moments.rows,
    )


def _reduced_hats(
    left: NDArray[np.intp], over: Floats, weight: Floats, count: int, prepared: Prepared
) -> Floats:
    """Reduced columns [N, count] of hats times a weight [T], a few at a time to spare memory."""
    parts = []
    for start in range(0, count, _AT_ONCE):
        width = min(_AT_ONCE, count - start)
        columns = np.zeros((len(left), width))
        for place, share in ((left, 1.0 - over), (left + 1, over)):
            rows = np.flatnonzero((place >= start) & (place < start + width))
            columns[rows, place[rows] - start] += weight[rows] * share[rows]
        parts.append(prepared.reduced(columns))
    return np.concatenate(parts, axis=1)
