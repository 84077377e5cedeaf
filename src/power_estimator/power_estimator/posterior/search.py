"""Search of the sets of effects that a model may miss, and their probabilities."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from power_estimator.effects.fit.design import Active, BasePower
from power_estimator.effects.signals.prepared import Prepared
from power_estimator.posterior.gaussian import Bools, NormalEquations, Solution, by_delay, solved
from power_estimator.posterior.meter import EffectColumns, MeterProblem, Point
from power_estimator.posterior.priors import (
    ALIKE,
    DEPARTING,
    DISCREPANCY,
    KNOWN_SIZE,
    MIMICS,
    MISSING,
    OF_USERS,
    SIZES,
    STEPS,
    TRIED,
    WORTH,
)

Floats = NDArray[np.float64]
Chosen = tuple[int, ...]
_ITERATIONS = 4
_SETTLED = 1.0  # nats
_NEGLIGIBLE = 8.0  # nats below the best size of the discrepancy
_SIZES = len(DISCREPANCY) * len(DEPARTING)
_CELLS = _SIZES * len(SIZES)


@dataclass(frozen=True)
class Cell:
    """A set at one size of the discrepancy and of new effects."""

    normal: NormalEquations
    sizes: Floats  # [n + z]
    solution: Solution


@dataclass(frozen=True)
class FittedSet:
    """A set of effects on one meter, at the set's own point."""

    evidence: float  # nats
    point: Point
    place: int  # of the delay among the shifts


def signs(actives: Sequence[Active]) -> Bools:
    """Mark coefficients that may not be negative [n]."""
    return np.array([term.lower >= 0 for a in actives for term in a.effect.terms], dtype=bool)


def cells(
    meter: MeterProblem, columns: EffectColumns, known: Sequence[str]
) -> tuple[list[Cell], int]:
    """Solve a linearised set at all sizes, at the best delay."""
    actives = columns.actives
    signed = signs(actives)
    flat = np.array([a.name in known for a in actives for _ in a.effect.terms], dtype=bool)
    ones = np.ones(columns.nuisance.shape[1])
    normals = meter.normals(columns)
    middle = np.concatenate([np.where(flat, KNOWN_SIZE, 0.3), ones])
    logs = np.array([by_delay(normal, middle) for normal in normals])
    place = int(np.argmax(logs.max(axis=0)))
    out = []
    for normal, log in zip(normals, logs[:, place], strict=True):
        if log < logs[:, place].max() - _NEGLIGIBLE:
            continue
        for size in SIZES if not flat.all() else SIZES[:1]:
            spread = np.concatenate([np.where(flat, KNOWN_SIZE, size), ones])
            out.append(Cell(normal, spread, solved(normal, place, spread, signed)))
    return out, place


def fit_set(
    meter: MeterProblem, actives: Sequence[Active], known: Sequence[str], start: Point
) -> FittedSet:
    """
    Fit a set of effects, each time linearised about the last, until its evidence stands still.

    A step after which there is less evidence than before is halved.
    """
    signed = signs(actives)
    point: Point = {a.name: (a, start[a.name][1]) for a in actives if a.name in start}
    before, values = np.zeros(len(signed)), np.zeros(len(signed))
    found: FittedSet | None = None
    for _ in range(_ITERATIONS):
        columns = meter.columns(actives, point)
        solutions, place = cells(meter, columns, known)
        logs = np.array([cell.solution.evidence for cell in solutions])
        evidence = float(
            logsumexp(logs) - np.log(_CELLS if not known_all(actives, known) else _SIZES)
        )
        if found is not None and evidence < found.evidence:
            values = 0.5 * (before + values)
            point = {active.name: (active, values[columns.places(active)]) for active in actives}
            continue
        settled = found is not None and evidence < found.evidence + _SETTLED
        if len(point) == len(actives):  # before that, departures of some are not there yet
            found = FittedSet(evidence, point, place)
        if settled:
            break
        best = solutions[int(np.argmax(logs))].solution
        before = np.zeros(len(signed))
        for active in actives:
            if active.name in point:
                before[columns.places(active)] = point[active.name][1]
        values = best.mean[: len(signed)] * columns.watts
        values = np.where(signed, np.maximum(values, 0.0), values)
        point = {active.name: (active, values[columns.places(active)]) for active in actives}
    assert found is not None
    return found


def known_all(actives: Sequence[Active], known: Sequence[str]) -> bool:
    """Return whether a set has no new effect, so that there is one size of such."""
    return all(active.name in known for active in actives)


class EffectSearch:
    """Sets of effects of one robot, from the model's own on, one effect more at a time."""

    def __init__(
        self,
        prepared: Prepared,
        known: Sequence[Active],
        candidates: Sequence[Active],
        base: BasePower | None = None,
    ) -> None:
        """known: effects of the model; candidates: shapes of effects that it may lack."""
        count = len(prepared.names)
        alone = count == 1
        fixed = [active for active in known if active.effect.fixed is not None]
        free = [active for active in known if active.effect.fixed is None]
        self.meters = [
            MeterProblem(
                prepared if alone else prepared.drive(d),
                fixed,
                base if base is None or alone else base.drive(d),
            )
            for d in range(count)
        ]
        self.known = tuple(active.name for active in free)
        self.actives = (*free, *candidates)
        self.names = [active.name for active in self.actives]
        self.shapes = {name: self.names.count(name) for name in self.names}
        self.base: Chosen = tuple(range(len(free)))
        self.points: list[Point] = [{} for _ in self.meters]
        self.judged: dict[Chosen, list[FittedSet]] = {}
        self.pooled = 1.0 / (1.0 + (count - 1) * ALIKE)
        self.screened: dict[str, tuple[float, Chosen]] = {}
        self.needed: dict[str, float] = {}  # log odds of effects of the set, as linearised
        self.made: list[EffectColumns] = []

    def run(self) -> tuple[Mapping[str, float], Chosen]:
        """Log odds of each effect that the model lacks, and the best set."""
        chosen = self.base
        self._begin()
        for _ in range(STEPS):
            self._move(chosen)
            nearest = self._nearest(chosen)
            here = self.score(chosen)
            tried = (*nearest[:TRIED], chosen)
            score, best = max((self.score(each), each) for each in tried)
            if score < here + WORTH:
                break
            chosen = best
        else:
            self._move(chosen)
            self._nearest(chosen)
        return self._odds(chosen), chosen

    def tempered(self, name: str, odds: float, ratio: float) -> float:
        """
        Log odds of an effect of the best set beside a discrepancy.

        ratio: of what the effect explains by itself to the discrepancy, W rms over W rms. With
        little of it, the evidence says no more than what was known before.
        """
        chance = MISSING.get(name.partition('@')[0], OF_USERS)
        before = float(np.log(chance / (1.0 - chance)))
        return tempered(before, odds, ratio)

    def _odds(self, chosen: Chosen) -> Mapping[str, float]:
        scores = {each: self.score(each) for each in self.judged}
        with_: dict[str, list[float]] = defaultdict(list)
        without: dict[str, list[float]] = defaultdict(list)
        lacking = [n for n in dict.fromkeys(self.names) if n not in self.known]
        for each, score in scores.items():
            own = {self.names[i] for i in each}
            for name in lacking:
                (with_ if name in own else without)[name].append(score)
        here = scores[chosen]
        least = min(s - here for s in scores.values())
        out = {}
        for name in lacking:
            if name in with_ and name in without:
                out[name] = float(logsumexp(with_[name]) - logsumexp(without[name]))
            elif name in with_:
                out[name] = self.needed.get(name, 0.0)
            elif name in self.screened:
                out[name] = float(min(self.screened[name][0] - here, least, -1.0))
            else:
                out[name] = -20.0
        return out

    def score(self, chosen: Chosen) -> float:
        """Log posterior of a set."""
        return self.pooled * sum(one.evidence for one in self.at(chosen)) + self._prior(chosen)

    def _prior(self, chosen: Chosen) -> float:
        own = {self.names[i] for i in chosen}
        total = 0.0
        for name in set(self.names) - set(self.known):
            chance = MISSING.get(name.partition('@')[0], OF_USERS)
            total += float(
                np.log(chance / self.shapes[name]) if name in own else np.log(1.0 - chance)
            )
        return total

    def at(self, chosen: Chosen) -> list[FittedSet]:
        """Return a set fitted to each meter."""
        key = tuple(sorted(chosen))
        if key not in self.judged:
            own = [self.actives[i] for i in key]
            self.judged[key] = [
                fit_set(meter, own, self.known, point)
                for meter, point in zip(self.meters, self.points, strict=True)
            ]
        return self.judged[key]

    def _move(self, chosen: Chosen) -> None:
        """Go to a set's own point; learn the noise there."""
        found = self.at(chosen)
        self.points = [one.point for one in found]
        for meter, one in zip(self.meters, found, strict=True):
            meter.place = one.place
        self._begin()

    def _begin(self) -> None:
        """Linearise all effects about the current points."""
        self.judged, self.made = {}, []
        for meter, point in zip(self.meters, self.points, strict=True):
            meter.absent = {}
            columns = meter.columns(self.actives, point)
            meter.learn_noise(columns, self.known)
            self.made.append(columns)

    def _nearest(self, chosen: Chosen) -> list[Chosen]:
        """Sets of one effect more, less, in place of another or of another shape, best first."""
        have = {self.names[i] for i in chosen}
        more = [
            tuple(sorted((*chosen, i))) for i, name in enumerate(self.names) if name not in have
        ]
        other = [
            tuple(sorted(i if k == j else k for k in chosen))
            for j in chosen
            for i, name in enumerate(self.names)
            if name == self.names[j] and i != j
        ]
        less = [tuple(i for i in chosen if i != j) for j in chosen if j not in self.base]
        swaps = [
            tuple(sorted((*fewer, i)))
            for fewer in less
            for i, name in enumerate(self.names)
            if name not in have
        ]
        totals = dict.fromkeys((*more, *other, *less, *swaps, chosen), 0.0)
        for meter, columns in zip(self.meters, self.made, strict=True):
            count, normals = columns.effects.shape[1], meter.normals(columns)
            slices = [columns.places(active) for active in self.actives]
            for each in totals:
                own = [c for i in each for c in range(slices[i].start, slices[i].stop)]
                kept = np.array([*own, *range(count, count + columns.nuisance.shape[1])])
                spread = np.ones(len(kept))
                spread[: len(own)] = 0.3
                totals[each] += max(
                    float(by_delay(normal.taken(kept, meter.place), spread)[0])
                    for normal in normals
                )
        here = self.pooled * totals.pop(chosen) + self._prior(chosen)
        best: dict[tuple[str, bool | Chosen | None], tuple[float, Chosen]] = {}
        for each, evidence in totals.items():
            new = next((self.names[i] for i in each if i not in chosen), '')
            grown = len(each) > len(chosen)
            key = (new, new in have if grown or new in have else each if not new else None)
            score = self.pooled * evidence + self._prior(each)
            best[key] = max(best.get(key, (-np.inf, each)), (score, each))
        self.needed = {
            self.names[next(i for i in chosen if i not in each)]: here - score
            for (name, _), (score, each) in best.items()
            if not name
        }
        at = self.score(chosen)
        self.screened = {
            name: (score - here + at, each)
            for (name, old), (score, each) in best.items()
            if old is False
        }
        return [each for _, each in sorted(best.values(), reverse=True)]


def tempered(before: float, after: float, ratio: float) -> float:
    """
    Log odds between those before and after the evidence, by a ratio to the discrepancy.

    Evidence against counts whole.
    """
    counts = ratio**2 / (ratio**2 + MIMICS**2)
    return before + counts * (after - before) if after > before else after
