"""Procedure that learns what a model misses and no catalogue has."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from power_estimator.effects import Catalogue
from power_estimator.effects.fit.blocks import one_thread_a_product
from power_estimator.effects.fit.candidate_screener import shaped
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.effects.fit.design_builder import Linearisation
from power_estimator.effects.fit.fitter import Fitter
from power_estimator.judge.evidence import Evidence, Examiner
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import printable

from power_lab.discover.effect_file import Written
from power_lab.discover.formula import Formula, refined
from power_lab.discover.found import (
    Discovery,
    Finalist,
    Found,
    bounds_of,
    interval_of,
    load_effect,
    without_superseded,
)
from power_lab.discover.known import MOST_NAMED, Named, named_instead, same_term
from power_lab.discover.selection import (
    CLOSE,
    Expression,
    Option,
    express,
    handicap,
    options,
    without_known,
)
from power_lab.discover.words import effect_name, excitation, free_name, in_short, look_alikes
from power_lab.structure.drivers import driver_values, families
from power_lab.structure.floors import above_floor, floors, unseen
from power_lab.structure.in_time import InTime, course_effect, in_time
from power_lab.structure.screening import DriverGain, DriverScreen, chance, promising
from power_lab.structure.shapes import DriveProblem, LearnedShape, learn, problems
from power_lab.structure.words import in_words

MOST_EFFECTS = 3
CERTAINTY = 0.05  # chance at which a share that is explained counts as chance
FLOOR, FLOOR_SHARE_OF_RMS = 0.15, 0.004
"""W, and share of the rms power: less structure than this is that of formulas not quite exact."""
_MOST_SAMPLED = 3.0
_NEXT_SHARE = 0.1  # in watts, of the first effect, that a further one must explain
_LEAST_OF_TIME = 0.6  # of what time explains, that the state must explain not to be time
_LEAST_OF_TIME_SLOW = {'voltage': 0.8, 'temperature': 1.15}
_SLOW = 0.9  # of a driver's variance in its means over a second, that time may stand for
_FINALISTS = 3  # options that are fitted with all else


Show = Callable[[str], None]


def _least(floor: Floats, error: Floats | float) -> Floats:
    """Least gain that counts as explained on a drive, W²; floor: W; error: squared, W²."""
    return np.maximum(0.3 * np.square(floor), 0.02 * error)


class Discoverer:
    """Learns effects that a model misses and no catalogue has, from prepared signals."""

    def __init__(
        self,
        fitter: Fitter,
        base: Structure,
        catalogue: Catalogue,
        show: Show = lambda text: None,
        seed: int = 0,
    ) -> None:
        self.fitter, self.structure, self.catalogue = fitter, base, catalogue
        self.examiner = Examiner(fitter)
        self.show, self.seed = show, seed
        self._trials = 0
        self._names_left = True

    @one_thread_a_product()
    def run(self) -> Discovery:
        """Learn effects one by one until what is left is chance or too small, at most three."""
        self.show('fitting the model')
        self.structure = shaped(self.fitter, self.examiner.folds, self.structure)
        base = best = self._examined(self.structure)
        usual = floors(self.fitter, FLOOR, FLOOR_SHARE_OF_RMS)
        sampled = unseen(self.fitter.prepared, base.fit)
        floor = np.clip(sampled, usual, _MOST_SAMPLED * usual)
        self._base = base.fit
        found: list[Found] = []
        named: list[Named] = []
        of_first, nothing = 1.0, ''
        while len(found) < MOST_EFFECTS:
            one, why, likely = self._next(best, floor, found)
            if not found:
                of_first = likely
            if one is None:
                nothing = why
                break
            if isinstance(one, Named):
                self.structure = self.structure.plus(one.active)
                best = one.after
                named.append(one)
                self._names_left = len(named) < MOST_NAMED
                continue
            best = self._with(one, best)
            found.append(one)
        found, best = without_superseded(found, best, self.structure, self._examined, floor)
        settled = tuple(self._settled(one, best) for one in found)
        return Discovery(settled, base, best, floor, of_first, nothing, tuple(named))

    def _examined(self, structure: Structure, start: Evidence | None = None) -> Evidence:
        whole, begin = structure.with_discrepancies(), None
        if start is not None:  # all blocks alike: those that an effect acts in fitted badly so far
            begin = replace(start.fit, weights=np.ones_like(start.fit.weights))
        return self.examiner.examine(self.fitter.fit(whole, begin, iterations=4))

    def _with(self, one: Found, best: Evidence) -> Evidence:
        assert one.effect is not None
        self.structure = self.structure.plus(Active.of(one.effect))
        return self._examined(self.structure, best)

    def _settled(self, one: Found, evidence: Evidence, term: str = '') -> Found:
        """The effect with coefficients, bounds and words of a fit; term: its name in that."""
        if one.formula is None:
            return one
        fit, rows = evidence.fit, list(one.drives)
        columns = fit.structure.columns_of(term or one.name)
        values = fit.coefficients[rows][:, columns]  # [d, n]
        between = self.fitter.intervals(fit, self.seed)[rows][:, columns]  # [d, n, 2]
        by_drive = dict(zip(rows, map(tuple, values.tolist()), strict=True))
        written = self._written(one.name, one.formula, by_drive, bounds_of(between, values))
        intervals = {
            drive: tuple((low, high) for low, high in own)
            for drive, own in zip(rows, between.tolist(), strict=True)
        }
        return replace(
            one,
            effect=load_effect(written),
            written=written,
            coefficients=by_drive,
            coefficient_intervals=intervals,
        )

    def _next(
        self, best: Evidence, floor: Floats, found: Sequence[Found]
    ) -> tuple[Found | Named | None, str, float]:
        fitter, prepared, number = self.fitter, self.fitter.prepared, len(found) + 1
        residual = self.examiner.residual(best)
        drives = problems(fitter, best, self.examiner.folds, residual)
        point = fitter.builder.point(best.fit.structure, best.fit.coefficients)
        courses_tried = (in_time(one, prepared.time, prepared.recording) for one in drives)
        in_times = {one.drive: one for one in courses_tried if one is not None}
        courses = {d: o for d, o in in_times.items() if o.gain >= 2.0 * float(floor[d]) ** 2}
        self.show(f'effect {number}: what it depends on')
        screened = [self._screened(problem, point) for problem in drives]
        base_error = {p.drive: max(p.base_error, 1e-9) for p in drives}
        likely = chance(screened, list(base_error.values()))
        explained = self._explained(drives, point, screened, number)
        least = {d: float(_least(floor[d], error)) for d, error in base_error.items()}
        ranked = options(explained, least, {d: float(floor[d]) ** 2 for d in least})
        in_time_gain = sum(one.gain for one in in_times.values())
        state_gain = ranked[0].shape_gain if ranked else 0.0
        least_share = self._least_of_time(ranked[0], point) if ranked else _LEAST_OF_TIME
        if courses and state_gain < least_share * in_time_gain:
            return self._course(courses, best, found), '', likely
        if not ranked:
            return None, 'nothing that is larger than what can be judged', likely
        ranked, repeated = without_known(
            ranked, lambda one: same_term(one, (self._base, best.fit), point, prepared)
        )
        if not ranked:
            return None, f'what is left goes as {in_words(repeated)}, which the model has', likely
        if likely > CERTAINTY and courses:
            return self._course(courses, best, found), '', likely
        if likely > CERTAINTY:
            return None, f'what is left is as large by chance in {likely:.0%} of cases', likely
        gain = np.zeros(len(floor))
        for drive, place in ranked[0].formula.places.items():
            gain[drive] = place.gain
        if not above_floor(gain, floor):
            size = float(np.sqrt(gain.max()))
            return None, f'{size:.2f} W of structure is less than can be judged', likely
        one = self._checked(ranked, best, floor, drives, point, found)
        if one is None:
            return None, 'no formula stands beside the refitted model', likely
        return one, '', likely

    def _least_of_time(self, option: Option, point: Linearisation) -> float:
        """Share of what time explains that an option must explain not to be time.

        A power over a driver that hardly changes within a second is hard to tell from a course in
        time. A voltage that goes with it is a cause; a temperature rises in most recordings.
        """
        family = option.formula.family
        if family.acts_on != 'power' or family.factor.symbol:
            return _LEAST_OF_TIME
        drive = max(option.formula.places, key=lambda d: option.formula.places[d].gain)
        z = self.fitter.prepared.reduced(driver_values(family.driver, point.signals, drive))
        within = z[self.fitter.blocks.rows].mean(axis=1)
        if within.var() < _SLOW * z.var():
            return _LEAST_OF_TIME
        return _LEAST_OF_TIME_SLOW.get(family.kind, _LEAST_OF_TIME_SLOW['temperature'])

    def _screened(self, problem: DriveProblem, point: Linearisation) -> list[DriverGain]:
        screen = DriverScreen(problem, point, self.fitter.prepared)
        found = (screen.screen(family) for family in families(point.signals, problem.drive))
        return [one for one in found if one is not None]

    def _explained(
        self,
        drives: Sequence[DriveProblem],
        point: Linearisation,
        screened: Sequence[Sequence[DriverGain]],
        number: int,
    ) -> dict[int, list[tuple[LearnedShape, list[Expression]]]]:
        """Shapes and formulas of the families that come into question, by drive."""
        prepared = self.fitter.prepared
        wanted = promising(screened)
        out: dict[int, list[tuple[LearnedShape, list[Expression]]]] = {}
        for problem, own in zip(drives, screened, strict=True):
            name = printable(prepared.names[problem.drive])
            self.show(f'effect {number}: shapes on {name} (of {len(drives)} drives)')
            best: dict[tuple[str, ...], DriverGain] = {}
            for one in own:
                known = best.get(one.family.group)
                if one.family.group in wanted and (known is None or one.gain > known.gain):
                    best[one.family.group] = one
            shapes = (learn(problem, one.family, point, prepared) for one in best.values())
            out[problem.drive] = [
                (shape, express(problem, shape) if shape.gain > 0.0 else [])
                for shape in shapes
                if shape is not None
            ]
        return out

    def _course(
        self, courses: Mapping[int, InTime], best: Evidence, found: Sequence[Found]
    ) -> Found:
        """Return the structure in time alone, kept beside all that follows and in no file."""
        largest = max(courses.values(), key=lambda one: one.gain)
        name = 'time_cycle' if largest.shape.period else 'time_drift'
        name = free_name(name, {one.name for one in found})
        names, drives = self.fitter.prepared.names, tuple(sorted(courses))
        effect = course_effect(name, {names[d]: one.shape for d, one in courses.items()})
        after = self._examined(self.structure.plus(Active.of(effect)), best)
        gain = best.mean_mse - after.mean_mse
        interval = interval_of(best, after, drives, self.seed)
        return Found(name, 'time', drives, gain, interval, effect=effect, course=largest)

    def _finalist(
        self,
        option: Option,
        best: Evidence,
        drives: Sequence[DriveProblem],
        point: Linearisation,
        found: Sequence[Found],
    ) -> Finalist:
        """An option with its parameters refined, fitted by the lab with all else."""
        prepared = self.fitter.prepared
        primitive = option.formula.primitive
        of_drive = {problem.drive: problem for problem in drives}
        places = {
            d: refined(of_drive[d], primitive, place, point, prepared)
            for d, place in option.formula.places.items()
        }
        formula = replace(option.formula, places=places)
        taken = {*self.catalogue, *self.structure.names, *(one.name for one in found)}
        name = effect_name(formula, taken)
        wide = [(-1e6, 1e6)] * primitive.terms
        ones = {d: (1.0,) * primitive.terms for d in places}
        self._trials += 1
        trial = f'{name}_trial_{self._trials}'  # the fitter keeps columns by name
        effect = load_effect(self._written(trial, formula, ones, wide))
        after = self._examined(self.structure.plus(Active.of(effect)), best)
        return Finalist(option, name, formula, effect, after, best.mean_mse - after.mean_mse)

    def _checked(
        self,
        ranked: Sequence[Option],
        best: Evidence,
        floor: Floats,
        drives: Sequence[DriveProblem],
        point: Linearisation,
        found: Sequence[Found],
    ) -> Found | Named | None:
        """The best of the first options, once each is fitted with all else."""
        self.show('refining the formula')
        close = [o for o in ranked[:_FINALISTS] if o.score >= CLOSE * ranked[0].score]
        finalists = [self._finalist(option, best, drives, point, found) for option in close]
        one = max(finalists, key=lambda f: f.gain.sum() * handicap(f.formula.family))
        option, formula, gain = one.option, one.formula, one.gain
        least = _least(floor, best.mean_mse)
        own = tuple(d for d in formula.places if gain[d] >= least[d])
        kept_gain = np.zeros(len(gain))
        kept_gain[list(own)] = gain[list(own)]
        if not own or not above_floor(kept_gain, floor):
            return None
        if found and kept_gain.sum() < _NEXT_SHARE**2 * found[0].gain.clip(0).sum():
            return None
        interval = interval_of(best, one.after, own, self.seed)
        if interval[0] <= 0.0:
            return None
        if self._names_left:
            known = self.examiner, self.catalogue, self.structure
            named = named_instead(*known, best, self._examined, least, float(kept_gain.sum()))
            if named is not None:
                return named
        learned = Found(
            name=one.name,
            kind=formula.kind,
            drives=own,
            gain=kept_gain,
            interval=interval,
            formula=replace(formula, places={d: formula.places[d] for d in own}),
            shapes=option.shapes,
            kept=min(1.0, option.kept),
            rivals=tuple(
                (other.text(), float(np.sqrt(max(option.formula.gain - other.gain, 0))))
                for other in (one.formula for one in ranked[1:4])
            ),
        )
        return self._settled(learned, one.after, one.effect.name)

    def _written(
        self,
        name: str,
        formula: Formula,
        values: Mapping[int, Sequence[float]],
        bounds: Sequence[tuple[float, float]],
    ) -> Written:
        names = self.fitter.prepared.names
        places: dict[str, dict[str, object]] = {}
        for drive, place in formula.places.items():
            driver = place.family.driver
            given: dict[str, object] = {
                key: float(f'{value:.6g}') for key, value in place.parameters.items()
            }
            if driver.memory:
                given['given'] = tuple(float(f'{v:.6g}') for v in driver.given)
            if driver.other:
                given['other'] = driver.other
            places[names[drive]] = given
        return Written(
            name=name,
            formula=formula,
            physics=in_short(formula, values, names),
            bounds=bounds,
            near=look_alikes(formula),
            excitation=excitation(formula),
            places=places,
        )
