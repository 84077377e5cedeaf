"""Search of the sets of effects that a robot's power may miss, and their probabilities."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from judgements import LEVELS, Interval, Judgement, Statement
from power_estimator.effects.fit.design import Active
from power_estimator.effects.signals.prepared import Prepared, prepare
from power_recordings.alignment.dataset import AlignedDataset
from scipy.special import log_ndtr, logsumexp, ndtri

from discrepancy.drive import DriveProblem, Point
from discrepancy.linear import Columns, Normal, bounded, solved
from discrepancy.priors import ALIKE, KNOWN_SIZE, MISSING, NAMED, SIZES, STEPS, TRIED, WORTH


@dataclass(frozen=True)
class Posterior:
    """One drive with one set of effects, at that set's own point."""

    evidence: float
    point: Point
    quantities: Mapping[str, tuple[float, float]]  # mean and spread


def posterior(
    drive: DriveProblem,
    actives: Sequence[Active],
    known: Sequence[str],
    start: Point,
    iterations: int,
) -> Posterior:
    """Fit a set of effects, each time linearised about the last."""
    point = {a.name: (a, start[a.name][1]) for a in actives if a.name in start}
    signed = np.array([term.lower >= 0 for a in actives for term in a.effect.terms])
    flat = np.array([a.name in known for a in actives for _ in a.effect.terms])
    for _ in range(iterations):
        columns = drive.columns(actives, point)
        count = columns.effects.shape[1]
        ones = np.ones(columns.nuisance.shape[1])
        cells = []
        for normal in drive.normals(columns):
            for size in SIZES if not flat.all() else SIZES[:1]:
                spread = np.concatenate([np.where(flat, KNOWN_SIZE, size), ones])
                log, mean, covariance = bounded(normal, spread, signed)
                shown = mean[:count] / np.sqrt(np.diag(covariance)[:count])
                log += float((log_ndtr(shown) + np.log(2.0))[signed].sum())  # no loss is negative
                cells.append((log, mean, covariance))
        _, mean, covariance = max(cells, key=lambda cell: cell[0])
        values = mean[:count] * columns.watts
        values = np.where(signed, np.maximum(values, 0.0), values)
        place, point = 0, {}
        for active in actives:
            point[active.name] = (active, values[place : place + len(active.effect.terms)])
            place += len(active.effect.terms)
    quantities = {
        name: (float(w @ mean), float(np.sqrt(w @ covariance @ w)))
        for name, w in columns.at_one.items()
    }
    logs = np.array([cell[0] for cell in cells])
    return Posterior(float(logsumexp(logs) - np.log(len(logs))), point, quantities)


class Search:
    """Sets of effects of one robot, from the model's own on, one effect more at a time."""

    def __init__(self, prepared: Prepared, known: Sequence[str]) -> None:
        several = len(prepared.names) > 1
        count = range(len(prepared.names))
        self.drives = [DriveProblem(prepared.drive(d) if several else prepared) for d in count]
        self.known = tuple(name for name in known if name in MISSING)
        self.candidates = self.drives[0].candidates
        self.points: list[Point] = [{} for _ in self.drives]
        self.judged: dict[tuple[int, ...], list[Posterior]] = {}
        self.pooled = 1.0 / (1.0 + (len(self.drives) - 1) * ALIKE)

    def run(self) -> tuple[dict[str, float], list[Posterior]]:
        """Probability of each effect that the model lacks, and the drives with the best set."""
        self._begin(delay=True)
        names = [active.name for active in self.candidates]
        chosen = tuple(sorted(names.index(name) for name in self.known if name in names))
        for step in range(STEPS):
            self.points = [one.point for one in self._at(chosen, 3)]
            screened = self._begin(delay=step == 0)
            here = self.score(chosen)
            nearest = self._nearest(chosen, screened)
            less = [
                tuple(i for i in chosen if i != j) for j in chosen if names[j] not in self.known
            ]
            score, best = max(
                (self.score(each), each) for each in (*nearest[:TRIED], *less, chosen)
            )
            if score < here + WORTH:
                break
            chosen = best
        scores = {each: self.score(each) for each in self.judged}
        total = logsumexp(list(scores.values()))
        found: dict[str, float] = defaultdict(float)
        for each, score in scores.items():
            for name in {names[i] for i in each} - set(self.known):
                found[name] += float(np.exp(score - total))
        return dict(found), self.judged[chosen]

    def score(self, chosen: tuple[int, ...]) -> float:
        """Log posterior of a set."""
        evidence = self.pooled * sum(one.evidence for one in self._at(chosen, 2))
        return evidence + self._prior({self.candidates[i].name for i in chosen})

    def _prior(self, names: set[str]) -> float:
        offered = {active.name for active in self.candidates} - set(self.known)
        return float(sum(np.log(MISSING[n] if n in names else 1 - MISSING[n]) for n in offered))

    def _at(self, chosen: tuple[int, ...], iterations: int) -> list[Posterior]:
        key = tuple(sorted(chosen))
        if key not in self.judged:
            actives = [self.candidates[i] for i in key]
            self.judged[key] = [
                posterior(drive, actives, self.known, point, iterations)
                for drive, point in zip(self.drives, self.points, strict=True)
            ]
        return self.judged[key]

    def _begin(self, *, delay: bool) -> list[Columns]:
        """Linearise all candidates about the current points; learn delay and noise there."""
        self.judged = {}
        for drive in self.drives:
            drive.absent = {}
        made = [
            d.columns(self.candidates, p) for d, p in zip(self.drives, self.points, strict=True)
        ]
        if delay:
            for drive, columns in zip(self.drives, made, strict=True):
                drive.find_delay(columns)
            common = float(np.median([drive.delay for drive in self.drives]))
            for drive in self.drives:
                drive.delay = common
        for drive, columns in zip(self.drives, made, strict=True):
            drive.learn_noise(columns, self.known)
        return made

    def _nearest(self, chosen: tuple[int, ...], made: Sequence[Columns]) -> list[tuple[int, ...]]:
        """Sets of one effect more, or of another shape, best first as linearised here."""
        names = [active.name for active in self.candidates]
        have = {names[i] for i in chosen}
        more = [tuple(sorted((*chosen, i))) for i, name in enumerate(names) if name not in have]
        other = [
            tuple(sorted(i if k == j else k for k in chosen))
            for j in chosen
            for i, name in enumerate(names)
            if name == names[j] and i != j
        ]
        places = np.cumsum([0, *(len(active.effect.terms) for active in self.candidates)])
        totals = dict.fromkeys((*more, *other), 0.0)
        for drive, columns in zip(self.drives, made, strict=True):
            count = columns.effects.shape[1]
            normals = drive.normals(columns)
            for each in totals:
                own = [c for i in each for c in range(places[i], places[i + 1])]
                kept = np.array([*own, *range(count, count + columns.nuisance.shape[1])])
                spread = np.ones(len(kept))
                spread[: len(own)] = 0.3
                totals[each] += max(
                    solved(Normal(n.gram[np.ix_(kept, kept)], n.moment[kept], n.constant), spread)[
                        0
                    ]
                    for n in normals
                )
        best: dict[tuple[str, bool], tuple[float, tuple[int, ...]]] = {}
        for each, evidence in totals.items():
            new = next((names[i] for i in each if i not in chosen), '')
            key = (new, new in have)
            score = self.pooled * evidence + self._prior({names[i] for i in each})
            best[key] = max(best.get(key, (-np.inf, each)), (score, each))
        return [each for _, each in sorted(best.values(), reverse=True)]


def judged(data: AlignedDataset, known: Sequence[str]) -> Judgement:
    """Judge a recording: probabilities of missing effects, and intervals of coefficients."""
    prepared = prepare(data)
    found, drives = Search(prepared, known).run()
    intervals = [
        Interval(name, quantity, level, mean - spread * reach, mean + spread * reach)
        for name, one in zip(prepared.names, drives, strict=True)
        for quantity, (mean, spread) in one.quantities.items()
        for level in LEVELS
        for reach in (float(ndtri(0.5 + level / 2)),)
    ]
    named = sorted(name for name, probability in found.items() if probability >= NAMED)
    statements = tuple(Statement(name, probability) for name, probability in found.items())
    return Judgement(statements, tuple(intervals), ' '.join(named) or 'nothing named')
