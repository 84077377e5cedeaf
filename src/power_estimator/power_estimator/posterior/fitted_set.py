"""Sets of effects fitted to one meter, each at its own point."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logsumexp
from wattwalk_core.arrays import Floats

from power_estimator.effects.fit.design import Active
from power_estimator.effects.fit.orders import ErrorsByPosition, errors_by_position
from power_estimator.posterior.effect_columns import EffectColumns
from power_estimator.posterior.gaussian import Bools, NormalEquations, Solution, by_delay, solved
from power_estimator.posterior.meter import MeterProblem, Point
from power_estimator.posterior.priors import DEPARTING, DISCREPANCY, KNOWN_SIZE, SIZES

_ITERATIONS = 6
_SETTLED = 1.0  # nats
_CLOSE = 0.5  # nats: a step that promises less is not taken
_STALE = 2  # points in turn that gain no more than that
_NEGLIGIBLE = 8.0  # nats below the best size of the discrepancy
_SIZES = len(DISCREPANCY) * len(DEPARTING)
LINEAR_SIZE = 0.3  # prior spread of new effects where sets are only screened


@dataclass(frozen=True)
class Cell:
    """A set at one size of the discrepancy and of new effects."""

    normal: NormalEquations
    sizes: Floats  # [n + z]
    solution: Solution
    place: int  # of the delay

    def at(self, values: Floats) -> float:
        """Evidence about coefficients [n] in place of the solution, in nats."""
        precision, pull = self._at(values)
        off = self.solution.mean[: len(values)] - values
        return self.solution.evidence - float(off @ pull - 0.5 * off @ precision @ off)

    def about(self, values: Floats, signed: Bools) -> 'Cell':
        """Return the cell whose solution is at coefficients [n].

        A signed one at 0 that is pulled below 0 stays so.
        """
        _, pull = self._at(values)
        pull = np.where(signed & (values == 0.0), np.maximum(pull, 0.0), pull)
        moments = self.normal.moments.copy()
        moments[: len(values), self.place] -= pull
        normal = replace(self.normal, moments=moments)
        solution = solved(normal, self.place, self.sizes, signed)
        return replace(self, normal=normal, solution=solution)

    def _at(self, values: Floats) -> tuple[Floats, Floats]:
        """Precision of effects beside any nuisances [n, n], and the log density's slope [n]."""
        count, place = len(values), slice(self.place, self.place + 1)
        gram = self.normal.gram + np.diag(self.sizes**-2.0)
        joined = np.concatenate([gram, self.normal.moments[:, place]], axis=1)
        taken = gram[:count, count:] @ np.linalg.solve(gram[count:, count:], joined[count:])
        left = joined[:count] - taken
        return left[:, :count], left[:, -1] - left[:, :count] @ values


@dataclass(frozen=True)
class FittedSet:
    """A set of effects on one meter, at the set's own point."""

    evidence: float  # nats
    point: Point
    place: int  # of the delay among the shifts
    promises: float  # nats that the point's linearisation has more


def signs(actives: Sequence[Active]) -> Bools:
    """Mark coefficients that may not be negative [n]."""
    return np.array([term.lower >= 0 for a in actives for term in a.effect.terms], dtype=bool)


def values_of(point: Point, actives: Sequence[Active]) -> Floats:
    """Coefficients of a point in SI, in the order of its effects [n]."""
    return np.concatenate([np.empty(0), *(point[active.name][1] for active in actives)])


def cells(
    meter: MeterProblem, columns: EffectColumns, known: Sequence[str]
) -> tuple[list[Cell], int]:
    """Solve a linearised set at the prior sizes that count, at the best delay, and its place.

    A size of the discrepancy counts within _NEGLIGIBLE of the best; known: effects of the model.
    """
    actives = columns.actives
    signed = signs(actives)
    names = [a.name for a in actives for _ in a.effect.terms]
    flat = np.array([name in known for name in names], dtype=bool)
    ones = np.ones(columns.nuisance.shape[1])
    normals = meter.normals(columns)
    middle = np.concatenate([np.where(flat, KNOWN_SIZE, LINEAR_SIZE), ones])
    logs = by_delay(normals, middle)
    place = int(np.argmax(logs.max(axis=0)))
    shared = np.array([name in meter.shares for name in names], dtype=bool)
    places = np.flatnonzero(shared & ~flat)
    shares = np.array([meter.shares[names[i]] for i in places]).reshape(-1, 2)
    mean, own = shares.T / columns.watts[places]
    out = []
    for k in np.flatnonzero(logs[:, place] >= logs[:, place].max() - _NEGLIGIBLE).tolist():
        normal = normals.at(k).centred(places, mean, own)
        for size in SIZES if not flat.all() else SIZES[:1]:
            spread = np.concatenate([np.where(flat, KNOWN_SIZE, size), ones])
            spread[places] = own
            out.append(Cell(normal, spread, solved(normal, place, spread, signed), place))
    return out, place


def fit_set(
    meter: MeterProblem,
    actives: Sequence[Active],
    known: Sequence[str],
    start: Point,
    elsewhere: float = np.inf,
) -> FittedSet:
    """Fit a set of effects, each time linearised about the last; return the best point of these.

    Departures are as large as the point has their effects. So a point counts by its own evidence,
    and not by that of the problem linearised there, whose solution may be far off. From a point
    with less than the last, the next step goes half of the way. elsewhere: evidence that another
    start led to; with nearly as much as that, this one is taken to lead there, too.
    """
    signed = signs(actives)
    point: Point = {a.name: (a, start[a.name][1]) for a in actives if a.name in start}
    new = any(active.name not in known for active in actives)  # else there is one size of such
    count = _SIZES * (len(SIZES) if new else 1)
    best: FittedSet | None = None
    here, last, stale = np.empty(0), -np.inf, 0
    for _ in range(_ITERATIONS):
        columns = meter.columns(actives, point)
        found, place = cells(meter, columns, known)
        logs = np.array([cell.solution.evidence for cell in found])
        evidence = -np.inf
        if len(point) == len(actives):  # before that, departures of some are not there yet
            here = values_of(point, actives)
            logs = np.array([cell.at(here / columns.watts) for cell in found])
            evidence = float(logsumexp(logs) - np.log(count))
            if best is None or evidence >= best.evidence + _SETTLED:
                stale = 0
            elif evidence < last + _SETTLED:  # on a half step back up it may still rise
                stale += 1
            linear = logsumexp([cell.solution.evidence for cell in found]) - np.log(count)
            promises = float(linear) - evidence
            if best is None or evidence > best.evidence:
                best = FittedSet(evidence, point, place, promises)
            close = promises < _CLOSE and best.point is point
            settled = abs(evidence - last) < _SETTLED or close or stale == _STALE
            if settled or 0.0 <= elsewhere - best.evidence < _SETTLED:
                break
        values = found[int(np.argmax(logs))].solution.mean[: len(signed)] * columns.watts
        values = np.where(signed, np.maximum(values, 0.0), values)
        if evidence < last:
            values = 0.5 * (values + here)
        last = evidence
        point = {active.name: (active, values[columns.places(active)]) for active in actives}
    assert best is not None
    return best


def errors_beside(
    meter: MeterProblem, sparse: MeterProblem, known: Sequence[Active]
) -> list[ErrorsByPosition]:
    """Return what effects leave of a meter's power, by the position of its drives.

    sparse: the same meter, on whose rows they are fitted.
    """
    if not sparse.used.any():
        return []
    point = settle(sparse, known, known, [active.name for active in known])
    meter.place = sparse.place
    meter.learn_noise(meter.columns(known, point), [active.name for active in known])
    assert meter.noise is not None
    rows, weights = meter.noise.rows, meter.noise.root
    slope = meter.prepared.reduced(meter.slope(point))
    slope[rows] *= weights
    error = meter.noise.left * weights[:, 0]
    return errors_by_position(meter.prepared, rows, error, slope)


def settle(
    meter: MeterProblem, actives: Sequence[Active], all_: Sequence[Active], known: Sequence[str]
) -> Point:
    """Return the point of a set on a meter; all_: effects beside which its noise is learned."""
    point: Point = {}
    for _ in range(2):
        meter.learn_noise(meter.columns(all_, point), known)
        found = fit_set(meter, actives, known, point)
        point, meter.place = found.point, found.place
    return point
