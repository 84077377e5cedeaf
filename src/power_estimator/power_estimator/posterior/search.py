"""Search of the sets of effects that a model may miss, and their probabilities."""

import itertools
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from scipy.special import logit, logsumexp
from wattwalk_core.arrays import Floats

from power_estimator.effects import Signals
from power_estimator.effects.fit.blocks import for_each
from power_estimator.effects.fit.design import Active
from power_estimator.posterior.effect_columns import EffectColumns
from power_estimator.posterior.fitted_set import LINEAR_SIZE, FittedSet, fit_set, settle, signs
from power_estimator.posterior.gaussian import NormalEquations, Solution, by_delay, solved
from power_estimator.posterior.meter import MeterProblem, Point, representatives
from power_estimator.posterior.odds import has_wholes, loses_twice, prior_of
from power_estimator.posterior.priors import ALIKE, KNOWN_SIZE, PAIRS, SHARES, STEPS, TRIED, WORTH

Chosen = tuple[int, ...]
_NEVER = -1e4  # nats
_LIKELY = 4.0  # the same, where sets are only screened
_PROMISES = 5.0  # nats that a point's linearisation has more: its fit has not converged
_SCREENINGS = 'here', 'plain', 'stiff'
"""About the current points; about no effects, without departures; with the least discrepancy."""


class EffectSearch:
    """Sets of effects of one robot: from the model's own on, one more, fewer or another."""

    def __init__(
        self,
        signals: Signals,
        problems: Sequence[MeterProblem],
        known: Sequence[Active],
        candidates: Sequence[Active],
        tried: Mapping[str, float],
        *,
        underneath: bool = False,
        show: Callable[[str], None] = lambda text: None,
    ) -> None:
        """known: free effects of the model; candidates: their other shapes, and what it may lack.

        tried: number of shapes that an effect's candidates are the best of; underneath: whether
        the model stands on another that may have any effect in it; show: what takes the number of
        sets that were fitted.
        """
        count, self.alone = len(problems), signals.torque.shape[1] == 1
        self.problems = problems
        self.searched = representatives(self.problems)
        self.meters = [self.problems[d] for d in self.searched]
        self.known = tuple(active.name for active in known)
        self.actives = (*known, *candidates)
        self.names = [active.name for active in self.actives]
        expected = {
            active.name
            for active in candidates
            if active.effect.shown_by(signals, active.parameters)
        } | {active.effect.part_of for active in known}
        self.prior = {name: prior_of(name, expected=name in expected) for name in self.names}
        self.underneath = underneath
        self.shapes = {name: self.names.count(name) for name in self.names} | dict(tried)
        self.base: Chosen = tuple(range(len(known)))
        self.points: list[Point] = [{} for _ in self.meters]
        self.judged: dict[Chosen, list[FittedSet]] = {}
        # Of many drives, those that are not searched are taken as they begin.
        self.shares_bus = 1 < count == len(self.meters)
        self.pooled = 1.0 / (1.0 + (len(self.meters) - 1) * ALIKE)
        self.made: list[EffectColumns] = []
        self._normals: dict[int, NormalEquations] = {}
        self._plain: tuple[list[EffectColumns], dict[int, NormalEquations]] = self.made, {}
        self._from_none: set[Chosen] = set()  # first steps that are promising about no effects
        self._show, self._fits = show, 0

    def run(self) -> Chosen:
        """Return the most probable set; judge its neighbours at their own points."""
        chosen = self.base
        self._begin()
        self._plain = self.made, {m: self.normals_of(m) for m in range(len(self.meters))}
        visited: set[Chosen] = set()
        gained = 0.0
        for _ in range(STEPS):
            visited.add(chosen)
            self._move(chosen)
            here = self.score(chosen)
            score, best = self._best((*self._promising(chosen), chosen))
            if score < here + WORTH:
                best = self._pruned(chosen)
            if best == chosen:
                best = self._with_two(chosen, here)
            gain = self.score(best) - here
            if best in visited:
                # This one, or one that was left beside another noise: the larger gain counts.
                if gain > gained:
                    chosen = best
                    self._move(chosen)
                break
            chosen, gained = best, gain
        else:
            self._move(chosen)
        self.score(tuple(i for i in chosen if self.names[i] in self.known))
        return chosen

    def _with_two(self, chosen: Chosen, here: float) -> Chosen:
        """Add the best two effects at once, each of which alone is worth nothing."""
        single = self.best_new(self.more(chosen), chosen, chosen)
        pairs = [
            tuple(sorted((*chosen, a, b)))
            for (_, a, _), (_, b, _) in itertools.combinations(single.values(), 2)
        ]
        screened = self.screened(pairs, chosen)
        likely = sorted(pairs, key=lambda each: -screened[each])[:PAIRS]
        score, best = self._best((*likely, chosen))
        return best if score >= here + WORTH else chosen

    def _best(self, sets: Sequence[Chosen]) -> tuple[float, Chosen]:
        """Best of some sets, each at its own point, and its log posterior."""
        self.fit(sets)
        return max((self.score(each), each) for each in sets)

    def _pruned(self, chosen: Chosen) -> Chosen:
        """Take out effects without which a set is as good, fitted without each of them."""
        while True:
            fewer = [tuple(i for i in chosen if i != j) for j in self.new_in(chosen)]
            if not fewer:
                return chosen
            score, best = self._best(fewer)
            if score < self.score(chosen):
                return chosen
            chosen = best

    def settled(self, chosen: Chosen) -> list[Point]:
        """Points of a set for all meters; those that were not searched are fitted now."""
        own = [self.actives[i] for i in sorted(chosen)]
        known = dict(zip(self.searched, (one.point for one in self.at(chosen)), strict=True))

        def point(d: int) -> Point:
            meter = self.problems[d]
            return known[d] if d in known else settle(meter, own, self.actives, self.known)

        return for_each(point, range(len(self.problems)))

    def prior_odds(self, name: str) -> float:
        """Log odds that the model lacks an effect, before the recording."""
        return float(logit(self.prior[name]))

    def odds_of(self, counts: Callable[[Chosen], bool]) -> float:
        """Log odds of the judged sets that count over the others; −inf where none counts."""
        with_ = [self.score(each) for each in self.judged if counts(each)]
        without = [self.score(each) for each in self.judged if not counts(each)]
        return float(logsumexp(with_) - logsumexp(without)) if with_ else -np.inf

    def odds_beside(self, name: str, chosen: Chosen, screened: float) -> float:
        """Log odds of an effect that is not in the best set; screened where none was judged."""
        found = self.odds_of(lambda each: name in self.names_of(each))
        if np.isfinite(found):
            return found
        least = min(self.score(each) for each in self.judged) - self.score(chosen)
        return min(screened, least, -1.0)

    def new_in(self, chosen: Chosen) -> Chosen:
        """Effects of a set that the model lacks."""
        return tuple(i for i in chosen if self.names[i] not in self.known)

    def names_of(self, chosen: Chosen) -> set[str]:
        """Effects of a set."""
        return {self.names[i] for i in chosen}

    def score(self, chosen: Chosen) -> float:
        """Log posterior of a set."""
        return self.pooled * sum(one.evidence for one in self.at(chosen)) + self._prior(chosen)

    def _prior(self, chosen: Chosen) -> float:
        own = self.names_of(chosen)
        new = [self.actives[i] for i in self.new_in(chosen)]
        if loses_twice(new, alone=self.alone) or not (self.underneath or has_wholes(new, own)):
            return _NEVER
        total = 0.0
        for name in set(self.names) - set(self.known):
            chance = self.prior[name]
            total += float(
                np.log(chance / self.shapes[name]) if name in own else np.log(1.0 - chance)
            )
        return total

    def at(self, chosen: Chosen) -> list[FittedSet]:
        """Return a set fitted to each meter."""
        self.fit([chosen])
        return self.judged[tuple(sorted(chosen))]

    def fit(self, sets: Sequence[Chosen]) -> None:
        """Fit sets to each meter, two at a time, which share threads evenly."""
        every, count = dict.fromkeys(tuple(sorted(each)) for each in sets), len(self.meters)
        new = [key for key in every if key not in self.judged]
        for two in (new[start : start + 2] for start in range(0, len(new), 2)):
            tasks = itertools.product(two, range(count))
            found = for_each(lambda task: self._fitted(*task), [*tasks])
            self.judged |= {key: found[k * count : (k + 1) * count] for k, key in enumerate(two)}
            self._fits += len(two)
            self._show(f'{self._fits} sets of effects are fitted')

    def _fitted(self, chosen: Chosen, m: int) -> FittedSet:
        """Return a set fitted to a meter, from two starts where its point may be far off."""
        meter, current = self.meters[m], self.points[m]
        actives = [self.actives[i] for i in chosen]
        start = {a.name: (a, current[a.name][1]) for a in actives if a.name in current}
        if len(start) < len(actives):
            start = self._linearised(m, actives, plain=False) | start
        found = fit_set(meter, actives, self.known, start)
        far = len(actives) < len(current) or found.promises > _PROMISES
        if not far and chosen not in self._from_none:
            return found
        start = self._linearised(m, actives, plain=True)
        other = fit_set(meter, actives, self.known, start, found.evidence)
        return max(found, other, key=lambda one: one.evidence)

    def _linearised(
        self, m: int, actives: Sequence[Active], *, plain: bool
    ) -> dict[str, tuple[Active, Floats]]:
        """Coefficients of a set as linearised about a meter's current point, or about none."""
        columns = (self._plain[0] if plain else self.made)[m]
        found, start = self.linearised(m, actives, plain=plain), 0
        point = {}
        for active in actives:
            place = columns.places(active)
            values = found.mean[start : start + place.stop - place.start] * columns.watts[place]
            start += len(values)
            signed = signs([active])
            point[active.name] = active, np.where(signed, np.maximum(values, 0.0), values)
        return point

    def linearised(self, m: int, actives: Sequence[Active], *, plain: bool = False) -> Solution:
        """Solve a set linearised about the current point, at the most probable discrepancy."""
        meter, columns = self.meters[m], (self._plain[0] if plain else self.made)[m]
        places = [np.r_[columns.places(active)] for active in actives]
        own = np.concatenate([np.empty(0, np.intp), *places])
        count = columns.effects.shape[1]
        kept = np.concatenate([own, np.arange(count, count + columns.nuisance.shape[1])])
        flat = [active.name in self.known for active in actives for _ in active.effect.terms]
        spread = np.ones(len(kept))
        spread[: len(own)] = np.where(flat, KNOWN_SIZE, LINEAR_SIZE)
        normals = self._plain[1][m] if plain else self.normals_of(m)
        taken = normals.taken(kept, meter.place)
        best = int(np.argmax(by_delay(taken, spread)[:, 0]))
        return solved(taken.at(best), 0, spread, signs(actives))

    def _move(self, chosen: Chosen) -> None:
        """Go to a set's own point; learn the noise there."""
        found = self.at(chosen)
        self.points = [one.point for one in found]
        for meter, one in zip(self.meters, found, strict=True):
            meter.place = one.place
        if self.shares_bus:
            drawn = np.concatenate(
                [m.drawn(point) for m, point in zip(self.meters, self.points, strict=True)], axis=1
            )
            for d, meter in enumerate(self.meters):
                meter.share_bus(np.delete(drawn, d, axis=1))
        self._begin()

    def _begin(self) -> None:
        """Linearise all effects about the current points."""
        self.judged, self._normals = {}, {}

        def linearised(m: int) -> EffectColumns:
            meter = self.meters[m]
            columns = meter.columns(self.actives, self.points[m])
            meter.learn_noise(columns, self.known)
            return columns

        self.made = for_each(linearised, range(len(self.meters)))

    def normals_of(self, m: int) -> NormalEquations:
        """Normal equations of all effects about the current point of a meter."""
        if m not in self._normals:
            self._normals[m] = self.meters[m].normals(self.made[m])
        return self._normals[m]

    def _promising(self, chosen: Chosen) -> list[Chosen]:
        """Best neighbours of a set, of kinds of steps that differ: more, fewer, a swap, a shape.

        Beside these come the best of the problem without departures, and with the least of them:
        they take over what is left of a friction that stands in for another, or a large effect.
        And the best other shape of a known effect, and the twins of new ones.
        """
        tried: list[Chosen] = []
        for how in _SCREENINGS:
            best = self._best_of(chosen, how)
            new = [each for each in best if self._new_name(each, chosen) not in self.known]
            tried += new[:TRIED]
            if how == 'plain' and not self.new_in(chosen):
                self._from_none = {*new[:TRIED], *self._twins(new[:TRIED], chosen)}
            tried += [each for each in best if each not in new][:1] if how == 'here' else []
        return list(dict.fromkeys(tried + self._twins(tried, chosen)))

    def _twins(self, sets: Sequence[Chosen], chosen: Chosen) -> list[Chosen]:
        """Sets with the other of SHARES in place of a new one: their own points tell which."""
        return [
            other
            for each in sets
            for i in self.new_in(each)
            if self.names[i] in SHARES and i not in chosen
            for other in self.swaps(each, i)
            if self._new_name(other, each) in SHARES
        ]

    def _best_of(self, chosen: Chosen, how: str) -> list[Chosen]:
        """Best neighbour of each kind of step as screened, the best kind first."""
        have = self.names_of(chosen)
        best: dict[object, tuple[float, Chosen]] = {}
        for each, score in self.screened(self._neighbours(chosen), chosen, how).items():
            new, grown = self._new_name(each, chosen), len(each) > len(chosen)
            kind = (new, new in have if grown or new in have else each if not new else None)
            best[kind] = max(best.get(kind, (-np.inf, each)), (score, each))
        return [each for _, each in sorted(best.values(), reverse=True)]

    def _new_name(self, each: Chosen, chosen: Chosen) -> str:
        """Effect that a set has in place of, or beside, those of another; '' if it has none."""
        return next((self.names[i] for i in each if i not in chosen), '')

    def _neighbours(self, chosen: Chosen) -> list[Chosen]:
        """Sets of one effect more, fewer, of another shape or in place of another."""
        other = self.reshaped(chosen, chosen)
        fewer = [tuple(i for i in chosen if i != j) for j in self.new_in(chosen)]
        swaps = [each for j in self.new_in(chosen) for each in self.swaps(chosen, j)]
        return [*self.more(chosen), *other, *fewer, *swaps]

    def reshaped(self, chosen: Chosen, which: Sequence[int]) -> list[Chosen]:
        """Sets with one of some effects in another shape."""
        return [
            tuple(sorted(i if k == j else k for k in chosen))
            for j in which
            for i, name in enumerate(self.names)
            if name == self.names[j] and i != j
        ]

    def more(self, chosen: Chosen) -> list[Chosen]:
        """Sets of one effect more."""
        have = self.names_of(chosen)
        return [
            tuple(sorted((*chosen, i))) for i, name in enumerate(self.names) if name not in have
        ]

    def swaps(self, chosen: Chosen, place: int) -> list[Chosen]:
        """Sets with another effect in the place of one."""
        fewer, own = tuple(i for i in chosen if i != place), self.names[place]
        return [each for each in self.more(fewer) if self._new_name(each, fewer) != own]

    def best_new(
        self, sets: Sequence[Chosen], rest: Chosen, chosen: Chosen
    ) -> dict[str, tuple[float, int, Chosen]]:
        """Screen sets with one effect more than the rest.

        Return score, new effect and set of the best for each name of a new effect.
        """
        best: dict[str, tuple[float, int, Chosen]] = {}
        for each, score in self.screened(sets, chosen).items():
            (new,) = (i for i in each if i not in rest)
            last = best.get(self.names[new])
            best[self.names[new]] = max(last or (-np.inf, new, each), (score, new, each))
        return best

    def screened(
        self, sets: Sequence[Chosen], chosen: Chosen, how: str = 'here'
    ) -> dict[Chosen, float]:
        """Log posteriors of sets linearised about the current points, which are of chosen.

        how: one of _SCREENINGS.
        """
        made = self._plain[0] if how == 'plain' else self.made
        every = tuple(dict.fromkeys((*sets, chosen)))

        def evidences(m: int) -> Floats:
            meter, columns = self.meters[m], made[m]
            slices = [columns.places(active) for active in self.actives]
            count = columns.effects.shape[1]
            nuisances = np.arange(count, count + columns.nuisance.shape[1])

            def at(each: Chosen, normals: NormalEquations) -> Floats:
                own = np.concatenate([np.r_[slices[i]] for i in each] or [nuisances[:0]])
                kept = np.concatenate([own, nuisances]).astype(np.intp)
                spread = np.ones(len(kept))
                spread[: len(own)] = LINEAR_SIZE
                return by_delay(normals.taken(kept, meter.place), spread)[:, 0]

            normals = self._plain[1][m] if how == 'plain' else self.normals_of(m)
            if how == 'stiff':
                normals = normals.at(np.arange(len(normals.gram)) == 0)
            first = at(chosen, normals)
            likely = normals.at(first > first.max() - _LIKELY)
            return np.array([at(each, likely).max() for each in every])

        totals = np.sum(for_each(evidences, range(len(self.meters))), axis=0)
        return {
            each: self.pooled * float(total) + self._prior(each)
            for each, total in zip(every, totals, strict=True)
            if each != chosen or each in sets
        }
