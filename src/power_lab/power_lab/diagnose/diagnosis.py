"""Diagnosis of a model: the posterior of what it lacks, beside errors on held-out data.

Sets of effects are searched in `power_estimator.posterior.search`.
"""

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import replace

import numpy as np
from power_estimator.effects import Catalogue
from power_estimator.effects.fit.candidate_screener import shaped
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.effects.fit.fitter import Fit
from power_estimator.effects.fit.per_recording import OWN_TERMS, has_own_terms
from power_estimator.effects.fit.whole_robot import shares_of_drives
from power_estimator.effects.signals.prepared import Prepared
from power_estimator.effects.training import Material
from power_estimator.judge.estimator import together
from power_estimator.judge.evidence import Evidence, Examiner
from power_estimator.posterior.judged import JudgedEffect, JudgedEffects, judged_effects
from power_estimator.posterior.priors import NAMED, OFF
from wattwalk_core.arrays import Floats

from power_lab.diagnose.findings import LEAST_FALL, UNLIKELY, Candidate, Diagnosis, Residual, short
from power_lab.structure.floors import unseen
from power_lab.structure.owners_terms import DriveAtWork, in_owners_terms

_ALONE = 2.0  # times the least residual, on one meter alone
_ACCOUNTED, _MENTIONED = 0.25, 0.1  # of the squared residual, of the largest cause
_MOST_CAUSES = 3
_OF_FORMULAS = 'departures of'  # causes that are an effect's departure from its formula


def chance_w2(evidence: Evidence, prepared: Prepared) -> Floats:
    """Squared error that no model can follow, W² [M].

    That is the meter's noise, and what the joint signals do between two samples.
    """
    by_chance = np.square(np.nan_to_num(prepared.noise))
    if not prepared.steady:
        by_chance = by_chance + np.square(unseen(prepared, evidence.fit))
    return by_chance


def residual(found: JudgedEffects, base: Evidence, best: Evidence, prepared: Prepared) -> Residual:
    """Held-out error that the named effects leave unexplained.

    found: gives the causes that it follows; base, best: evidence without and with the named
    effects. It counts if, by its rms, it reaches the usual scale error of a good sensor times the
    power, or twice that on a single meter.
    """
    by_chance = chance_w2(best, prepared)
    left = np.maximum(best.mean_mse - by_chance, 0.0)
    missed = np.maximum(base.mean_mse - chance_w2(base, prepared), left)
    power = np.nanmean(np.square(prepared.power_at(0.0)), axis=0)
    share = left / np.maximum(power, 1e-12)
    counts = share.mean() >= OFF**2 or share.max() >= (_ALONE * OFF) ** 2
    return Residual(
        left=left,
        missed=missed,
        by_chance=by_chance,
        power=power,
        noise=prepared.noise,
        over=_causes(found, left, prepared),
        names=tuple(prepared.names),
        counts=bool(counts),
    )


def _causes(found: JudgedEffects, left: Floats, prepared: Prepared) -> tuple[str, ...]:
    """Causes of the discrepancy, largest first, where they account for the residual, W² [M]."""
    sizes: dict[str, list[float]] = {}
    for one in found.meters:
        for cause, watts in one.left.items():
            if not cause.startswith(_OF_FORMULAS):
                sizes.setdefault(cause, []).append(watts)
    pooled = {cause: sum(watts**2 for watts in own) for cause, own in sizes.items()}
    if not pooled or sum(pooled.values()) < _ACCOUNTED * left.sum():
        return ()
    order = sorted(pooled, key=lambda cause: -pooled[cause])[:_MOST_CAUSES]
    shown = [cause for cause in order if pooled[cause] >= _MENTIONED * pooled[order[0]]]
    if len(left) < 2:
        return tuple(shown)
    worst = {cause: prepared.names[int(np.argmax(sizes[cause]))] for cause in shown}
    return tuple(cause if cause == 'time' else f'{cause} of {worst[cause]}' for cause in shown)


_BEYOND = 1.25  # times a share, more than errors of sensors make of it
_TOO_LITTLE = 0.01  # of what the largest candidate explains, to be compared at all
_TIED = 0.998
"""Correlation of what two effects explain above which they are one family here."""


class AddedEffects:
    """Held-out errors of a base model, and of effects that are added to it."""

    def __init__(self, material: Material, base: Structure, seed: int = 0) -> None:
        """Base holds the model's effects and the measurement terms."""
        self.fitter, self.seed = material.fitter(per_drive=True), seed
        self.examiner = Examiner(self.fitter, by_recording=not has_own_terms(base))
        self.structure = shaped(self.fitter, self.examiner.folds, base)
        start = self.fitter.fit(self.structure.with_discrepancies(), iterations=4)
        self.base = self.examiner.examine(start)

    def added(self, actives: Sequence[Active], iterations: int = 2) -> Evidence:
        """The base with effects, all fitted anew."""
        whole = self.structure.plus(*actives).with_discrepancies()
        fit = self.fitter.fit(whole, self.base.fit, iterations=iterations)
        return self.examiner.examine(fit, [active.name for active in actives])

    def reshaped(self, known: Sequence[Active]) -> 'AddedEffects':
        """Errors of a base whose effects have the shapes of known ones."""
        shapes = {active.name: active for active in known}
        structure = Structure(tuple(shapes.get(one.name, one) for one in self.structure.actives))
        if structure == self.structure:
            return self
        out = copy(self)
        out.structure = structure
        start = self.fitter.fit(structure.with_discrepancies(), self.base.fit, iterations=4)
        out.base = self.examiner.examine(start)
        return out


def diagnosed(
    material: Material,
    known: Sequence[Active],
    catalogue: Catalogue,
    seed: int = 0,
    show: Callable[[str], None] = lambda text: None,
) -> Diagnosis:
    """Find the effects that a model lacks, from all recordings of one robot together.

    known: effects of the model; show: takes texts of progress.
    """
    structure = material.structure(known)
    own, terms, delays = together(material, structure, catalogue)
    fits = AddedEffects(own, structure.plus(*terms), seed)
    physics = [active for active in fits.structure.actives if active.effect.kind == 'physics']
    found = judged_effects(own.prepared, physics, catalogue, own.base_power, show)
    apart: dict[str, Floats] = {}
    if has_own_terms(fits.structure):
        fits = fits.reshaped(found.known)
        fit = fits.added(found.added).fit
        apart = _apart(fit)
        alike = _alike(own.prepared, fit, apart)
        found = judged_effects(alike, physics, catalogue, own.base_power, show)
    show('holding the effects against held-out data')
    if delays.any():
        apart['time_offset'] = np.tile(delays, (len(own.prepared.names), 1))
    fits = fits.reshaped(found.known)
    found, best = _borne_out(_possible(found), fits)
    alone = [_candidate(one, found, fits) for one in found.candidates]
    families = _families(alone)
    candidates = tuple(replace(one, family=families[one.name]) for one in alone)
    if (name := _outdone(candidates, float(np.sqrt(fits.base.mean_mse.mean())))) is not None:
        found, best = found.doubting(name), fits.base
        doubted = found.probability[name]
        candidates = tuple(
            replace(one, probability=doubted) if one.name == name else one for one in candidates
        )
    return Diagnosis(
        found=found,
        prepared=own.prepared,
        apart=apart,
        base=fits.base,
        best=best,
        candidates=candidates,
        left=residual(found, fits.base, best, own.prepared),
    )


def _possible(found: JudgedEffects) -> JudgedEffects:
    """Doubt named effects that would take more than there is, as a gear 149 % of its load."""
    for active in found.named:
        drawn = [meter.coefficients[active.name] for meter in found.meters]
        most = np.max([np.median(own, axis=0) for own in drawn], axis=0)
        for value, term in zip(most.tolist(), active.effect.terms, strict=True):
            if term.unit == '1' and value > _BEYOND * term.upper:
                found = found.doubting(active.name)
    return found


def _outdone(candidates: Sequence[Candidate], error: float) -> str | None:
    """Return the only named effect, if an improbable one alone lowers the held-out error more.

    error: of the model, W, of which more by LEAST_FALL counts.
    """
    named = [one for one in candidates if one.probability >= NAMED]
    if len(named) != 1:
        return None
    (name,) = named
    rivals = [one.delta_rmse_w for one in candidates if one.probability < UNLIKELY]
    least = name.delta_rmse_w + LEAST_FALL * error
    return name.name if max(rivals, default=-np.inf) > least else None


def _apart(fit: Fit) -> dict[str, Floats]:
    """Terms of the measurement of each recording less their mean over all [M, R]."""
    out = {}
    for name in OWN_TERMS:
        values = fit.coefficients[:, fit.structure.columns_of(name)]
        if values.shape[1] > 1:
            out[name] = values - values.mean(axis=1, keepdims=True)
    return out


def _alike(prepared: Prepared, fit: Fit, apart: Mapping[str, Floats]) -> Prepared:
    """Signals with the power as if all recordings had the same errors of the meter."""
    excess = sum(
        np.einsum('nmr,mr->nm', fit.design.columns[..., fit.structure.columns_of(name)], values)
        for name, values in apart.items()
    )
    return replace(prepared, power=(prepared.power - excess).astype(prepared.power.dtype))


def _borne_out(found: JudgedEffects, fits: AddedEffects) -> tuple[JudgedEffects, Evidence]:
    """Doubt named effects that hardly lower the held-out error beside the others, worst first.

    Return what is left of the names, and the held-out errors with these.
    """
    best = fits.added(found.named, 3) if found.named else fits.base
    while named := found.named:
        chance = chance_w2(best, fits.fitter.prepared)
        less = {a.name: fits.added([one for one in named if one is not a], 3) for a in named}
        least = (1.0 + LEAST_FALL) * np.sqrt(np.maximum(best.mean_mse - chance, 0.0))
        rises = {
            name: float(np.nanmax(np.sqrt(np.maximum(one.mean_mse - chance, 0.0)) - least))
            for name, one in less.items()
        }
        worst = min(rises, key=lambda name: rises[name])
        if rises[worst] > 0.0:
            return found, best
        found, best = found.doubting(worst), less[worst]
    return found, fits.base


def _candidate(judged: JudgedEffect, found: JudgedEffects, fits: AddedEffects) -> Candidate:
    """An effect as the posterior has it, and added to the base alone."""
    active, prepared = judged.active, fits.fitter.prepared
    evidence = fits.added((active,), 1)
    fit = evidence.fit
    gain = fits.base.mean_mse - evidence.mean_mse
    before, after = (np.sqrt(one.mean_mse.mean()) for one in (fits.base, evidence))
    variance = np.nansum(np.nanvar(prepared.power_at(0.0), axis=0))
    missed = float(np.maximum(fits.base.mean_mse - chance_w2(fits.base, prepared), 0.0).sum())
    low, middle, high = judged.explains.tolist()
    drive, columns = int(np.argmax(gain)), fit.structure.columns_of(active.name)
    size = np.sqrt(np.nanmean(np.square(fit.design.columns[:, drive, columns]), axis=0))
    lead = int(np.argmax(np.abs(fit.coefficients[drive, columns]) * size))
    copper = fit.coefficients[drive, fit.structure.columns_of('copper_loss')]
    if active.name in {one.name for one in found.added}:
        drawn = [meter.coefficients[active.name] for meter in found.meters]
        values = np.array([np.median(own, axis=0) for own in drawn])
        interval = np.quantile(drawn[drive][:, lead], [0.025, 0.975])
        copper = np.median(found.meters[drive].coefficients.get('copper_loss', [[]]), axis=0)
    else:
        values = fit.coefficients[:, columns]
        place = drive, columns[lead]
        interval = fits.fitter.intervals(fit, fits.seed)[place]
        if not interval[0] <= values[drive, lead] <= interval[1]:
            values[drive, lead] = fits.fitter.intervals(fit, fits.seed, level=0.0)[place][0]
    names = prepared.names
    if prepared.whole and (shares := shares_of_drives(active.effect)) is not None:
        values, names = values * shares, prepared.signals.names
        regressors = active.effect.regressors(prepared.signals, **active.parameters)
        drive = int(np.argmax(np.square(regressors[..., lead]).mean(axis=0)))
        interval = np.array(interval) * shares[drive, lead]
    term = active.effect.terms[lead]
    value, bounds = float(values[drive, lead]), (float(interval[0]), float(interval[1]))
    read_beside = DriveAtWork.of(prepared, drive, float(copper[0]) if copper.size else 0.0)
    return Candidate(
        active=active,
        probability=judged.probability,
        explains=(low, middle, high),
        share=float(np.clip(gain.sum() / max(missed, 1e-12), 0.0, 1.0)),
        family='',
        delta_r2=float(gain.sum() / max(variance, 1e-12)),
        delta_rmse_w=float(before - after),
        symbol=term.symbol,
        unit=term.unit,
        coefficient=value,
        interval=bounds,
        owners_terms=in_owners_terms(active, term.symbol, value, bounds, read_beside),
        drive=names[drive],
        coefficients={
            name: [short(value) for value in row]
            for name, row in zip(names, values.tolist(), strict=True)
        },
        explained=(fits.base.fit.residual() - fit.residual()).astype(np.float32),
    )


def _families(alone: Sequence[Candidate]) -> Mapping[str, str]:
    """Effects that explain the same in this recording, joined by slashes."""
    explained = [np.nan_to_num(one.explained).ravel() for one in alone]
    size = [float(np.linalg.norm(part)) for part in explained]
    tied = {one.name: {one.name, *one.active.effect.ties} for one in alone}
    for a, own in enumerate(alone):
        for b, other in enumerate(alone[:a]):
            if min(size[a], size[b]) < _TOO_LITTLE * max(size):
                continue
            if float(explained[a] @ explained[b]) > _TIED * size[a] * size[b]:
                tied[own.name].add(other.name)
                tied[other.name].add(own.name)
    return {name: '/'.join(sorted(own)) for name, own in tied.items()}
