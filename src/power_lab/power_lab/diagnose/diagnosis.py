"""Procedure that finds the effect that a model lacks, and its verdict."""

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from power_estimator.effects import Catalogue
from power_estimator.effects.fit.candidate_screener import CandidateScreener, Screened, shaped
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.effects.fit.fitter import Fit, Fitter
from power_estimator.effects.fit.per_recording import has_own_terms
from power_estimator.judge.evidence import Evidence, Examiner

from power_lab.diagnose.beside import beside
from power_lab.diagnose.confidence_set import confidence_set
from power_lab.diagnose.findings import Candidate, Diagnosis, Step, Verdict
from power_lab.diagnose.look_alikes import look_alikes
from power_lab.diagnose.residual_structure import ResidualStructure, examine_structure
from power_lab.structure.candidates import CONSTANT_TORQUE, best_shapes, candidates
from power_lab.structure.floors import (
    above_floor,
    beyond_physics,
    floors,
    negligible,
    shared,
    unseen,
)

Floats = NDArray[np.float64]

NAME_FLOOR, NAME_SHARE_OF_RMS = 0.1, 0.0015
"""W, and share of the rms power: an effect that explains less is not worth a name."""
STRUCTURE_FLOOR, STRUCTURE_SHARE_OF_RMS = 0.15, 0.004
"""The same for structure that no effect explains; formulas are not more accurate than this."""
NEXT_SHARE = 0.02
"""A further effect must explain this share, in watts, of what the others do."""
TO_THE_NOISE = 0.9
"""
Or this share of the squared error that is left above the meter's noise: where a large effect's
formula does not quite fit, no other effect explains all of the rest.
"""
NAMED_SHARE, NAMED_SHARE_QUIET = 0.8, 0.5
"""
Named effects must explain this share of all that can be explained; half of it where what is left
is too small to be an unmodelled effect.
"""
EARNED_SHARE, EARNED_BESIDE_STRUCTURE = 0.4, 0.8
"""
The last effect to join must explain this share of what was still to be explained; more where
what is left is large enough to be an unmodelled effect, which a wrong name explains in part.
"""
_FINALISTS, _EXTRAS, _SWAPS = 6, 3, 2
_TESTED_SWAPS = 20  # of those that fit best, on held-out data
MOST_RIVALS = 3
"""That a further effect may have."""
_FAR_BEHIND = 2.0  # of the log error by drive: a first step that leaves seven times the error
_MOST_SAMPLED = 3.0  # times its usual size may sampling raise the floor of unmodelled effects
_LEAST_FALL = 1e-3  # of the log error, for another shape
_EVENT, _EVENT_SHARE = 20.0, 0.05  # times the median squared error; of the blocks at most
_BESIDE_CONSTANT = 2.0  # times its watts must an effect explain beside a constant torque


class Diagnoser:
    """Runs the procedure on one set of prepared signals."""

    def __init__(
        self, fitter: Fitter, base: Structure, catalogue: Catalogue, seed: int = 0
    ) -> None:
        """Base holds the model's effects and the measurement terms."""
        self.fitter = fitter
        self.examiner = Examiner(fitter, by_recording=not has_own_terms(base))
        self.structure = base
        self.base = base
        self.catalogue = catalogue
        self.seed = seed
        self.floor = floors(fitter, NAME_FLOOR, NAME_SHARE_OF_RMS)
        self.structure_floor = floors(fitter, STRUCTURE_FLOOR, STRUCTURE_SHARE_OF_RMS)
        self.candidates = candidates(fitter, base, catalogue)

    def run(self) -> Diagnosis:
        """All of it, again beside free shapes where known effects do not explain enough."""
        return beside(self.alone(), self, self._again)

    def _again(self, shapes: Sequence[Active]) -> Diagnosis:
        base = self.structure.plus(*shapes)
        return Diagnoser(self.fitter, base, self.catalogue, self.seed).alone(events=False)

    def alone(self, *, events: bool = True) -> Diagnosis:
        """The procedure with the known effects alone; events: leave out what nothing follows."""
        none = self._base()
        screener = self._screener(none)
        found = best_shapes(screener)
        odd = self._events(none, screener, found) if events else np.zeros(0, dtype=bool)
        if odd.any():
            self.fitter.leave_out(odd)
            none = self.examiner.examine(self.fitter.fit(self.base, none.fit, iterations=2))
            screener = CandidateScreener(
                self.fitter, self.examiner.folds, none.fit, self.candidates
            )
            found = best_shapes(screener)
        usual = self.structure_floor
        sampled = unseen(self.fitter.prepared, none.fit)
        self.structure_floor = np.clip(sampled, usual, _MOST_SAMPLED * usual)
        singles = self._singles(none, screener, found)
        ladder, steps = [none], []
        while len(ladder) <= len(found):
            step, better = self._next(none, ladder[-1], screener, found, singles)
            steps.append(step)
            if better is None:
                break
            grown = self._reshaped(self._without_redundant(better))
            if frozenset(grown.names) in [frozenset(rung.names) for rung in ladder]:
                break
            ladder.append(grown)
            steps[-1] = steps[-1].less(set(better.names) - set(grown.names))
        return self._judge(ladder, singles, steps)

    def _screener(self, none: Evidence) -> CandidateScreener:
        folds = self.examiner.folds
        return CandidateScreener(self.fitter, folds, none.fit, self.candidates)

    def _base(self) -> Evidence:
        """The base alone, its shapes chosen, bent as real drives are."""
        self.structure = shaped(self.fitter, self.examiner.folds, self.structure)
        self.base = self.structure.with_discrepancies()
        return self.examiner.examine(self.fitter.fit(self.base, iterations=4))

    def _events(
        self, none: Evidence, screener: CandidateScreener, found: dict[str, Screened]
    ) -> NDArray[np.bool_]:
        """
        Blocks [B, D] that not even all candidates together follow: stumbles, pushes.

        At most a twentieth of the recording; what fails more often is no event.
        """
        together = screener.screen([screened.actives[0] for screened in found.values()])
        best = np.fmin(none.mse, together.mse)
        limit = np.maximum(
            _EVENT * np.nanmedian(best, axis=0), np.nanquantile(best, 1 - _EVENT_SHARE, axis=0)
        )
        return np.nan_to_num(best) > limit

    def _singles(
        self, none: Evidence, screener: CandidateScreener, found: dict[str, Screened]
    ) -> tuple[Candidate, ...]:
        order = sorted(found.values(), key=lambda screened: screened.loss)
        residual = none.fit.residual()
        out: list[Candidate] = []
        raced = self._race(none.fit, [screened.actives for screened in order[:_FINALISTS]])
        for rank, screened in enumerate(order):
            active = screened.actives[0]
            evidence = raced[rank] if rank < len(raced) else self.added(none.fit, (active,), 1)
            fit, gain = evidence.fit, none.mean_mse - evidence.mean_mse
            place = fit.structure.columns_of(active.name)
            columns = fit.design.columns[..., place].astype(np.float32)
            intervals = self.fitter.intervals(fit, self.seed)[:, place]
            explained = (residual - fit.residual()).astype(np.float32)
            out.append(
                Candidate(active.name, active, evidence, gain, columns, intervals, explained)
            )
        return tuple(sorted(out, key=lambda c: float(c.evidence.loss.mean())))

    def _race(self, start: Fit, sets: Sequence[Sequence[Active]]) -> list[Evidence]:
        """Each set fitted; those far behind one before them for one iteration only."""
        out: list[Evidence] = []
        margin = _FAR_BEHIND * len(self.fitter.prepared.names)
        for actives in sets:
            best = min((evidence.fit.error for evidence in out), default=np.inf)
            out.append(self.added(start, actives, give_up=best + margin))
        return out

    def added(
        self,
        start: Fit,
        actives: Sequence[Active],
        iterations: int = 3,
        give_up: float = np.inf,
    ) -> Evidence:
        """The base with effects added, all fitted anew from a start; give_up: as for a fit."""
        structure = self.base
        for active in actives:
            structure = structure.without(active.name)
        structure = structure.plus(*actives)
        fit = self.fitter.fit(
            structure.with_discrepancies(), start, iterations=iterations, give_up=give_up
        )
        return self.examiner.examine(fit, [active.name for active in actives])

    def _next(
        self,
        none: Evidence,
        best: Evidence,
        screener: CandidateScreener,
        found: dict[str, Screened],
        singles: Sequence[Candidate],
    ) -> tuple[Step, Evidence | None]:
        """The best set with one effect more, if it is worth it; singles: those of one."""
        chosen = best.names
        sets = self._rivals(best, screener, found)
        if chosen:
            finalists = self._race(best.fit, sets)
        else:
            finalists = [one.evidence for one in singles if (one.active,) in sets]
        finalists = [e for e in finalists if not negligible(e, self.fitter.scale)] or finalists[:1]
        finalists.sort(key=lambda e: float(e.loss.mean()))
        losses = [best.loss, *(e.loss for e in finalists)]
        members = confidence_set(losses, seed=self.seed)
        gain = best.mean_mse - finalists[0].mean_mse
        first = none.mean_mse - best.mean_mse
        worth = above_floor(gain, self.floor) and not negligible(finalists[0], self.fitter.scale)
        if chosen:
            large = gain.sum() >= NEXT_SHARE**2 * first.sum()
            worth = worth and bool(large or self._to_the_noise(gain, finalists[0]))
            worth = worth and sum(i > 0 for i in members) <= MOST_RIVALS
            worth = worth and shared(gain, self.floor)
        step = Step(
            chosen,
            tuple(finalists[i - 1].names for i in members if i > 0),
            0 in members,
            finalists[0].names,
            gain,
        )
        if 0 in members or not worth:
            return step, None
        return step, finalists[0]

    def _to_the_noise(self, gain: Floats, after: Evidence) -> bool:
        """Return whether an effect explains all that was left but the meter's noise."""
        noise = np.square(np.nan_to_num(self.fitter.prepared.noise))
        left = np.maximum(after.mean_mse - noise, 0.0)
        return bool(gain.sum() >= TO_THE_NOISE * (gain + left).sum())

    def _reshaped(self, evidence: Evidence) -> Evidence:
        """
        Choose the shapes of the added effects anew, from neighbour to neighbour.

        Screening chose them linearised about a fit without these effects, which misleads where
        they are large.
        """
        for name in evidence.names:
            better: Evidence | None = evidence
            while better is not None:
                evidence = better
                better = self._better_neighbour(evidence, name)
        return evidence

    def _better_neighbour(self, evidence: Evidence, name: str) -> Evidence | None:
        own = evidence.actives
        active = next(a for a in own if a.name == name)
        for shape in self._other_shapes(active):
            changed = tuple(shape if a.name == name else a for a in own)
            trial = self.added(evidence.fit, changed, 2)
            if trial.fit.error < evidence.fit.error - _LEAST_FALL:
                return trial
        return None

    def _other_shapes(self, active: Active) -> list[Active]:
        same = [c for c in self.candidates if c.name == active.name]
        if len(same) < 2:
            return []
        place = same.index(active) if active in same else 0
        return [same[i] for i in (place - 1, place + 1) if 0 <= i < len(same)]

    def _without_redundant(self, evidence: Evidence) -> Evidence:
        """Drop effects that later ones have made superfluous."""
        for name in evidence.names[:-1]:
            less = self._without(evidence, name)
            gain = less.mean_mse - evidence.mean_mse
            if len(less.names) > 1 and not above_floor(gain, self.floor):
                return self._without_redundant(less)
        return evidence

    def _rivals(
        self, best: Evidence, screener: CandidateScreener, found: dict[str, Screened]
    ) -> list[tuple[Active, ...]]:
        """Sets of one effect more that come into question, by screening."""
        if not best.names:
            order = sorted(found.values(), key=lambda screened: screened.loss)
            return [screened.actives for screened in order[:_FINALISTS]]
        own = best.actives
        others = [active for active in self.candidates if active.name not in best.names]
        beside = CandidateScreener(self.fitter, self.examiner.folds, best.fit, others)
        extras = sorted(best_shapes(beside).values(), key=lambda screened: screened.loss)
        sets = [(*own, *screened.actives) for screened in extras[:_EXTRAS]]
        new = [name for name in found if name not in best.names]
        swaps = [
            (*(name for name in best.names if name != left_out), *pair)
            for left_out in best.names
            for pair in itertools.combinations(new, 2)
        ]
        trials = screener.fitted([[found[name].actives[0] for name in each] for each in swaps])
        trials.sort(key=lambda trial: trial.error)
        screened = sorted(screener.tested(trials[:_TESTED_SWAPS]), key=lambda one: one.loss)
        return sets + [one.actives for one in screened[:_SWAPS]]

    def _judge(
        self, ladder: list[Evidence], singles: tuple[Candidate, ...], steps: list[Step]
    ) -> Diagnosis:
        ladder = list(ladder)
        none = ladder[0]
        unexplained = self.unexplained(ladder[-1])
        beyond = tuple(dict.fromkeys(name for rung in ladder for name in beyond_physics(rung)))
        while beyond_physics(ladder[-1]):
            ladder.pop()
            unexplained = self.unexplained(ladder[-1])
        while len(ladder) > 2 and not self._earned(ladder[-2], ladder[-1], unexplained):
            ladder.pop()
            unexplained = self.unexplained(ladder[-1])
        best, chosen = ladder[-1], ladder[-1].names
        explained = np.maximum(none.mean_mse - best.mean_mse, 0.0)
        explainable = explained + unexplained.explained
        share = float(explained.sum() / max(explainable.sum(), 1e-12))
        possible = steps[len(ladder) - 2].members if chosen else ()
        possible = self._beside_constant(best, possible)
        possible = tuple(dict.fromkeys((*possible, *self._alike(none, best, singles))))
        effects = tuple(dict.fromkeys((*chosen, *itertools.chain(*possible))))
        certain = frozenset.intersection(*(frozenset(m) for m in possible)) if possible else ()
        verdict: Verdict
        constant = chosen == (CONSTANT_TORQUE,) and len(possible) == 1
        unmodelled = above_floor(unexplained.explained, self.structure_floor)
        if constant:
            verdict, effects = 'none_of_the_above', ()
        elif not chosen:
            verdict, effects = ('none_of_the_above' if unmodelled else 'no_evidence'), ()
        elif share < (NAMED_SHARE if unmodelled else NAMED_SHARE_QUIET):
            verdict = 'none_of_the_above' if unmodelled else 'no_evidence'
            effects = ()
        elif len(possible) > 1:
            verdict = 'ambiguous'
        else:
            verdict, effects = 'named', tuple(n for n in chosen if n != CONSTANT_TORQUE)
            possible = (effects,)
        named = verdict in ('named', 'ambiguous')
        return Diagnosis(
            verdict=verdict,
            effects=effects,
            base=none,
            best=best,
            chosen=chosen,
            singles=singles,
            in_set=frozenset(itertools.chain(*(possible or (steps[0].members if steps else ())))),
            certain=frozenset(certain) if named else frozenset(),
            possible=possible if named else (),
            ladder=tuple(ladder),
            explained=explained,
            unexplained=unexplained,
            floor=self.floor,
            structure_floor=self.structure_floor,
            share=share,
            steps=tuple(steps),
            beyond=beyond,
            noise=self.fitter.prepared.noise,
        )

    def _beside_constant(
        self, best: Evidence, possible: tuple[tuple[str, ...], ...]
    ) -> tuple[tuple[str, ...], ...]:
        """
        Sets that may be missing; beside a constant torque an effect must explain twice its watts.

        Friction in one direction is a constant torque and Coulomb friction of one size.
        """
        if CONSTANT_TORQUE not in best.names or len(best.names) < 2:
            return possible
        alone = {name: self._without(best, name).mean_mse for name in best.names}
        gains = {name: float((mse - best.mean_mse).sum()) for name, mse in alone.items()}
        least = _BESIDE_CONSTANT**2 * gains[CONSTANT_TORQUE]
        open_ = [n for n in best.names if n != CONSTANT_TORQUE and gains[n] < least]
        rest = [tuple(n for n in best.names if n != name) for name in open_]
        return tuple(dict.fromkeys((*possible, *rest)))

    def _alike(
        self, none: Evidence, best: Evidence, singles: Sequence[Candidate]
    ) -> tuple[tuple[str, ...], ...]:
        """Sets that formulas are not exact enough to tell from the best."""
        others = [c.active for c in singles if c.name not in best.names]

        def added(actives: Sequence[Active]) -> Evidence:
            return self.added(best.fit, actives)

        return look_alikes(none, best, others, added, self.structure_floor)

    def _without(self, evidence: Evidence, name: str) -> Evidence:
        return self.added(evidence.fit, tuple(a for a in evidence.actives if a.name != name))

    def unexplained(self, evidence: Evidence) -> ResidualStructure:
        """Structure that is left of what a model does not explain."""
        residual = self.examiner.residual(evidence)
        fitter = self.fitter
        return examine_structure(
            residual, fitter.prepared, fitter.blocks, self.examiner.folds, self.seed
        )

    def _earned(self, before: Evidence, after: Evidence, unexplained: ResidualStructure) -> bool:
        """Return whether the last effect explains most of the structure before it."""
        gain = float(np.maximum(before.mean_mse - after.mean_mse, 0.0).sum())
        unmodelled = above_floor(unexplained.explained, self.structure_floor)
        least = EARNED_BESIDE_STRUCTURE if unmodelled else EARNED_SHARE
        return gain >= least * (gain + float(unexplained.explained.sum()))
