"""Candidates: the catalogue's effects that a model lacks, in all their shapes."""

from dataclasses import replace

from power_estimator.effects import Catalogue, Effect
from power_estimator.effects.fit.candidate_screener import CandidateScreener, Screened, Trial
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.effects.fit.fitter import Fitter
from power_estimator.effects.fit.whole_robot import shared_by_size


def with_free_coefficient(of: Effect) -> Effect:
    """An effect whose coefficient physics fixes, free enough to compete for a place."""
    term = replace(of.terms[0], lower=0.0, upper=1.5)
    return replace(of, terms=(term,), fixed=None, made=(with_free_coefficient, (of,)))


def candidates(fitter: Fitter, base: Structure, catalogue: Catalogue) -> list[Active]:
    """Physical effects that the base has not, in every usable shape."""
    signals, whole = fitter.prepared.signals, fitter.prepared.whole
    known = {name.partition('@')[0] for name in base.names}
    effects = [
        effect if effect.fixed is None else with_free_coefficient(effect)
        for effect in catalogue.physics()
        if effect.name not in known and (effect.fixed is None or fitter.builder.base is None)
    ]
    return [
        Active.of(shared_by_size(effect, signals) if whole else effect, shape)
        for effect in effects
        for shape in effect.tried_on(signals)
    ]


def best_shapes(screener: CandidateScreener) -> dict[str, Screened]:
    """For each effect the screening of its best shape."""
    best: dict[str, Trial] = {}
    for trial in screener.fitted([[active] for active in screener.candidates]):
        name = trial.actives[0].name
        if name not in best or trial.error < best[name].error:
            best[name] = trial
    return dict(zip(best, screener.tested(list(best.values())), strict=True))
