"""Effects that have a name: candidates of the catalogue, and terms that the model has."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from power_estimator.effects import Catalogue, Effect
from power_estimator.effects.fit.candidate_screener import CandidateScreener, Trial
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.effects.fit.design_builder import Linearisation
from power_estimator.effects.fit.fitter import Fit, Fitter
from power_estimator.effects.fit.orders import PERIODIC, orders_of_fit
from power_estimator.effects.signals.prepared import Prepared
from power_estimator.judge.evidence import Evidence, Examiner
from wattwalk_core.arrays import Floats

from power_lab.discover.formula import Formula
from power_lab.structure.floors import beyond_physics
from power_lab.structure.shapes import instant


def with_free_coefficient(of: Effect) -> Effect:
    """Copy of an effect whose fixed coefficient is free between 0 and 1.5."""
    term = replace(of.terms[0], lower=0.0, upper=1.5)
    return replace(of, terms=(term,), fixed=None, made=(with_free_coefficient, (of,)))


def candidates(fitter: Fitter, base: Structure, catalogue: Catalogue) -> list[Active]:
    """Physical effects of the catalogue that the base lacks, in each shape the signals allow."""
    signals = fitter.prepared.signals
    known = {name.partition('@')[0] for name in base.names}
    effects = [
        effect if effect.fixed is None else with_free_coefficient(effect)
        for effect in catalogue.physics()
        if effect.name not in known and (effect.fixed is None or fitter.builder.base is None)
    ]
    found = [Active.of(effect, shape) for effect in effects for shape in effect.tried_on(signals)]
    if cogging := [active for active in found if active.name == PERIODIC]:
        orders = orders_of_fit(fitter.fit(base, iterations=3))
        effect = cogging[0].effect
        found += [Active.of(effect, shape) for shape in orders.shapes(effect, signals)]
    return list(dict.fromkeys(found))


MOST_NAMED = 3
AS_GOOD, LEAST_OF_TWO = 0.95, 0.75
"""
Share of a formula's gain from which on named effects are preferred to it, and that one of two has.
"""
_FITTED = 2  # candidates that are fitted with all else
_SAME = 0.98
"""R² of a formula on one term of the model above which it is that term under another name."""
_NOTHING = 1e-9  # of a column's variance against its square


@dataclass(frozen=True)
class Named:
    """Effect of the catalogue that explains the power a formula was to be learned for."""

    name: str
    active: Active
    after: Evidence
    gain: Floats  # W² [D], held out
    drives: tuple[int, ...]

    @property
    def explains(self) -> float:
        """Rms power that it explains over its drives, W."""
        return explained_w(self.gain, self.drives)


def explained_w(gain: Floats, drives: Sequence[int]) -> float:
    """Rms power over some drives in W, of held-out gains, W² [D]."""
    return float(np.sqrt(np.maximum(gain[list(drives)], 0.0).mean()))


Examined = Callable[[Structure, Evidence], Evidence]
"""Function that refits terms from a fit and returns their held-out errors."""


def named_instead(
    examiner: Examiner,
    catalogue: Catalogue,
    structure: Structure,
    best: Evidence,
    examined: Examined,
    least: Floats,
    gain: float,
) -> Named | None:
    """Return an effect of the catalogue in place of a formula, None where none explains enough.

    It explains 95 % or more of the formula's gain (W²), alone or as the first of two. structure,
    best: the model and its fit; least: W² [D] that counts as explained on a drive.
    """

    def best_beside(structure: Structure, best: Evidence) -> Named | None:
        """Candidate that explains most beside a model, if any is left."""
        left = candidates(examiner.fitter, best.fit.structure, catalogue)
        if not left:
            return None
        screener = CandidateScreener(examiner.fitter, examiner.folds, best.fit, left)
        shapes: dict[str, Trial] = {}
        for trial in screener.fitted([[active] for active in left]):
            name = trial.actives[0].name
            if name not in shapes or trial.error < shapes[name].error:
                shapes[name] = trial
        tested = screener.tested(list(shapes.values()))
        found: list[Named] = []
        for screened in sorted(tested, key=lambda one: float(one.mean_mse.sum()))[:_FITTED]:
            active = screened.actives[0]
            after = examined(structure.plus(active), best)
            fall = best.mean_mse - after.mean_mse
            drives = tuple(np.flatnonzero(fall >= least).tolist())
            own = Evidence(after.fit, after.coefficients, after.mse, (active.name,))
            if drives and active.name not in beyond_physics(own):
                found.append(Named(active.name, active, after, fall, drives))
        return max(found, key=lambda one: float(one.gain.sum()), default=None)

    first = best_beside(structure, best)
    if first is None or first.gain.sum() < LEAST_OF_TWO * gain:
        return None
    if first.gain.sum() >= AS_GOOD * gain:
        return first
    second = best_beside(structure.plus(first.active), first.after)
    both = first.gain.sum() + (0.0 if second is None else second.gain.sum())
    return first if both >= AS_GOOD * gain else None


def same_term(
    formula: Formula, fits: Sequence[Fit], point: Linearisation, prepared: Prepared
) -> str:
    """Name of a term of fitted models that the formula repeats on all its drives, '' for none.

    A term counts with its allowed departure: copper loss of a bent exponent is copper loss.
    """
    if formula.primitive.terms > 1:
        return ''
    names: set[str] | None = None
    for drive, place in formula.places.items():
        z, weight = instant(place.family, point, drive)
        column = formula.primitive.columns(z, dict(place.parameters)) * weight[:, None]
        values = prepared.reduced(column)[:, 0]
        own = {name for fit in fits for name in _alike(values, fit, drive)}
        names = own if names is None else names & own
    return min(names or {''})


def _alike(values: Floats, fit: Fit, drive: int) -> list[str]:
    structure = fit.structure
    out = []
    for active in structure.free:
        if active.effect.kind != 'physics':
            continue
        places = structure.columns_of(active.name)
        places += [
            place
            for other in structure.free
            if other.effect.departs_from == active.name
            for place in structure.columns_of(other.name)
        ]
        columns = fit.design.columns[:, drive, places]
        if _share(values, columns) >= _SAME:
            out.append(active.name)
    return out


def _share(values: Floats, columns: Floats) -> float:
    """R² of values [N] on columns [N, n], all about their means."""
    rows = np.isfinite(values) & np.isfinite(columns).all(axis=1)
    target = values[rows] - values[rows].mean()
    total = float(target @ target)
    known = columns[rows] - columns[rows].mean(axis=0)
    size = np.square(known).sum(axis=0)
    known = known[:, size > _NOTHING * np.square(columns[rows]).sum(axis=0)]
    if total <= 0.0 or known.shape[1] == 0:
        return 0.0
    solved = np.linalg.lstsq(known, target, rcond=None)[0]
    left = target - known @ solved
    return 1.0 - float(left @ left) / total
