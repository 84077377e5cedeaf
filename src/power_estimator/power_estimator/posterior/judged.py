"""Judgement of prepared signals by the posterior: probabilities, scales, and what is left."""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.special import expit, logit, ndtr
from wattwalk_core.arrays import Floats

from power_estimator.effects import Catalogue, Effect, Signals
from power_estimator.effects.effect import Shape
from power_estimator.effects.fit.blocks import for_each, one_thread_a_product
from power_estimator.effects.fit.design import Active, BasePower
from power_estimator.effects.fit.orders import PERIODIC, Orders, orders_of
from power_estimator.effects.fit.whole_robot import shared_by_size
from power_estimator.effects.signals.pieces import sparse
from power_estimator.effects.signals.prepared import Prepared
from power_estimator.posterior.effect_columns import explained
from power_estimator.posterior.fitted_set import errors_beside, signs
from power_estimator.posterior.meter import meter_problems, representatives
from power_estimator.posterior.odds import tempered
from power_estimator.posterior.priors import DOUBTED, NAMED, OFF, SENSORS_OFF
from power_estimator.posterior.rates import with_quiet_rates
from power_estimator.posterior.search import Chosen, EffectSearch
from power_estimator.posterior.sensors import SCALES, spreads
from power_estimator.posterior.stand_ins import InSet, judged_set, ratio_of
from power_estimator.posterior.summary import MeterSummary, rms, summarised

_LEVELS: Final = (0.025, 0.5, 0.975)
_DRAWS: Final = 200
_RESOLVED: Final = 0.002  # of some hundred draws
_WEIGHS: Final = 0.1  # probability of another set from which it is fitted for its scales


@dataclass(frozen=True)
class JudgedEffect:
    """An effect that the model may lack, in the most probable set or beside it."""

    active: Active
    probability: float  # that it is missing
    explains: Floats  # W rms over the meters at 2.5, 50 and 97.5 % [3]
    share: float  # of what the model misses, by the square of its watts


@dataclass(frozen=True)
class OneOfSeveral:
    """Effects of which the recording does not tell the one that is missing."""

    names: tuple[str, ...]  # the most probable first
    probability: float  # that one of them is


@dataclass(frozen=True)
class JudgedEffects:
    """Probabilities that effects are missing, and what each meter's posterior says."""

    candidates: tuple[JudgedEffect, ...]  # the most probable first
    any_missing: float  # probability that any effect is missing
    scales: Mapping[str, float]  # probability that the meter's gain, the torque's scale is off
    known: tuple[Active, ...]  # effects of the model in their most probable shapes
    added: tuple[Active, ...]  # and what the most probable set has beside them
    meters: tuple[MeterSummary, ...]
    left_w: float  # rms of the discrepancy
    undecided: tuple[OneOfSeveral, ...] = ()  # with certainty

    @property
    def probability(self) -> Mapping[str, float]:
        """Probability that each effect is missing."""
        return {one.active.name: one.probability for one in self.candidates}

    def doubting(self, name: str) -> 'JudgedEffects':
        """Return the judgement where an effect is no more certain than DOUBTED."""
        candidates = [
            replace(one, probability=min(one.probability, DOUBTED))
            if one.active.name == name
            else one
            for one in self.candidates
        ]
        any_missing = self.any_missing
        if not any(one.probability >= NAMED for one in candidates):
            left = [one.probability for one in candidates]
            left += [one.probability for one in self.undecided]
            any_missing = min(any_missing, max(left))
        return replace(self, candidates=_in_order(candidates), any_missing=any_missing)

    @property
    def named(self) -> tuple[Active, ...]:
        """Effects that are missing with certainty."""
        own = {active.name for active in self.added}
        likely = (one.active for one in self.candidates if one.probability >= NAMED)
        return tuple(active for active in likely if active.name in own)


@one_thread_a_product()
def judged_effects(
    prepared: Prepared,
    known: Sequence[Active],
    catalogue: Catalogue,
    base: BasePower | None = None,
    show: Callable[[str], None] = lambda text: None,
) -> JudgedEffects:
    """Judge which effects of a catalogue a model of known ones lacks; show: how far it is."""
    prepared = replace(prepared, signals=with_quiet_rates(prepared.signals))
    signals = prepared.signals
    names = {active.name.partition('@')[0] for active in known}
    fixed = [active for active in known if active.effect.fixed is not None]
    free = [active for active in known if active.effect.fixed is None]
    apart = sparse(prepared)
    cogs = any(one.name == PERIODIC and one.tried_on(signals) for one in catalogue.physics())
    orders = _orders((prepared, apart), fixed, free, base) if cogs else Orders()
    problems = meter_problems(apart, fixed, base)
    lacking = [
        Active.of(shared_by_size(effect, signals) if prepared.whole else effect, shape)
        for effect in catalogue.physics()
        if effect.name not in names and effect.fixed is None
        if effect.proposed is None or effect.proposed(signals)
        for shape in _shapes(effect, signals, orders)
    ]
    other_shapes = [
        Active.of(active.effect, shape)
        for active in free
        for shape in _shapes(active.effect, signals, orders)
        if shape != active.parameters
    ]
    search = EffectSearch(
        signals,
        problems,
        free,
        [*other_shapes, *lacking],
        {PERIODIC: orders.tried},
        underneath=base is not None,
        show=show,
    )
    chosen = search.run()
    points = search.settled(chosen)
    taken = [search.actives[i] for i in sorted(chosen)]
    meters = for_each(
        lambda d: summarised(search.problems[d], taken, search.known, points[d]),
        range(len(points)),
    )
    left = rms(np.array([one.misses_w for one in meters]))
    expected = rms(np.array([one.discrepancy_w for one in meters]))
    searched = [meters[d] for d in search.searched]
    in_set = judged_set(search, chosen, searched)
    judged = _candidates(search, chosen, meters, in_set, left)
    new = search.new_in(chosen)
    added = tuple(search.actives[i] for i in sorted(new))
    return JudgedEffects(
        candidates=judged,
        any_missing=_any_missing(search, judged, added, expected),
        scales=_scales(search, chosen, meters, in_set, judged),
        known=tuple(search.actives[i] for i in sorted(chosen) if i not in new),
        added=added,
        meters=tuple(meters),
        left_w=left,
        undecided=_undecided(search, in_set),
    )


def _orders(
    prepared: tuple[Prepared, Prepared],
    fixed: Sequence[Active],
    known: Sequence[Active],
    base: BasePower | None,
) -> Orders:
    """Orders of cogging that a model may lack, or may have in another order.

    prepared: all rows, and those that effects are fitted on.
    """
    own = [active for active in known if active.name.partition('@')[0] != PERIODIC]
    meters, fitted = (meter_problems(one, fixed, base) for one in prepared)
    searched = representatives(meters)
    errors = for_each(lambda d: errors_beside(meters[d], fitted[d], own), searched)
    return orders_of(list(itertools.chain(*errors)))


def _shapes(effect: Effect, signals: Signals, orders: Orders) -> list[Shape]:
    """Shapes of an effect that are searched.

    Iron loss whose current heats the winding is friction by another name.
    """
    if effect.name.partition('@')[0] == PERIODIC:
        return orders.shapes(effect, signals)
    return [shape for shape in effect.tried_on(signals) if not shape.get('carried')]


def _candidates(
    search: EffectSearch,
    chosen: Chosen,
    meters: Sequence[MeterSummary],
    in_set: Sequence[InSet],
    left: float,
) -> tuple[JudgedEffect, ...]:
    """Effects of the set, and all others beside it or in the place of one of them."""
    found: list[tuple[int, Floats, float]] = []
    instead = _instead(search, in_set)
    for one in in_set:
        name = search.names[one.place]
        levels = [np.quantile(own.explains[name], _LEVELS) for own in meters]
        found.append((one.place, _rms_levels(levels), float(expit(one.log_odds))))
    misses = sum(explains[1] ** 2 for _, explains, _ in found) + left**2
    sizes = np.array([max(meters[d].discrepancy_w, 1e-12) for d in search.searched])
    here = search.screened([chosen], chosen)[chosen]
    for name, (score, new, _) in search.best_new(search.more(chosen), chosen, chosen).items():
        explains = np.array([_beside(search, m, chosen, new) for m in range(len(search.meters))])
        odds = search.odds_beside(name, chosen, score - here)
        log = tempered(search.prior_odds(name), odds, ratio_of(explains[:, 1], sizes))
        probability = max(float(expit(log)), instead.get(name, 0.0))
        found.append((new, _rms_levels(explains), probability))
    out = [
        JudgedEffect(
            search.actives[place],
            probability,
            explains,
            float(explains[1] ** 2 / max(misses, 1e-12)),
        )
        for place, explains, probability in found
    ]
    return _in_order(out)


def _beside(search: EffectSearch, m: int, chosen: Chosen, new: int) -> Floats:
    """W rms [3] at 2.5, 50 and 97.5 % that an effect explains beside a set on a meter.

    It is linearised about the set, at the most probable discrepancy.
    """
    actives = [search.actives[i] for i in (*chosen, new)]
    found = search.linearised(m, actives)
    count = sum(len(active.effect.terms) for active in actives)
    terms = slice(count - len(actives[-1].effect.terms), count)
    mean, covariance = found.mean[terms], found.covariance[terms, terms]
    drawn = np.random.default_rng(0).multivariate_normal(mean, covariance, _DRAWS)
    drawn = np.where(signs(actives[-1:]), np.maximum(drawn, 0.0), drawn)
    others = [*search.names_of(chosen)]
    watts = explained(search.made[m], search.meters[m].used, actives[-1], drawn, others)
    return np.asarray(np.quantile(watts, _LEVELS))


def _instead(search: EffectSearch, in_set: Sequence[InSet]) -> Mapping[str, float]:
    """Probability by name of each effect that may be in the place of one of the best set."""
    found: dict[str, float] = {}
    for one in in_set:
        for other in one.stand_ins:
            name = search.names[other.effect]
            found[name] = max(found.get(name, 0.0), one.probability(other))
    return found


def _undecided(search: EffectSearch, in_set: Sequence[InSet]) -> tuple[OneOfSeveral, ...]:
    """Return effects of the set that are not certain, with those in their place that may be."""
    found = []
    for one in in_set:
        likely = {search.names[one.place]: float(expit(one.log_odds))}
        for other in one.stand_ins:
            if (probability := one.probability(other)) >= _WEIGHS:
                likely[search.names[other.effect]] = probability
        total = sum(likely.values())
        if max(likely.values()) < NAMED <= total and len(likely) > 1:
            names = sorted(likely, key=lambda name: -likely[name])
            found.append(OneOfSeveral(tuple(names), total))
    return tuple(found)


def _in_order(candidates: Sequence[JudgedEffect]) -> tuple[JudgedEffect, ...]:
    """The most probable first, then what explains most."""
    return tuple(sorted(candidates, key=lambda one: (-one.probability, -one.explains[1])))


def _rms_levels(levels: Sequence[Floats] | Floats) -> Floats:
    """W rms over meters [3] of levels [M, 3]."""
    return np.sqrt(np.mean(np.square(levels), axis=0))


def _any_missing(
    search: EffectSearch,
    candidates: Sequence[JudgedEffect],
    added: Sequence[Active],
    left: float,
) -> float:
    """Probability that an effect is missing, whichever it is."""
    most = max((one.probability for one in candidates), default=0.0)
    names = {active.name for active in added}
    watts = [one.explains[1] for one in candidates if one.active.name in names]
    if not watts:
        return most
    odds = search.odds_of(lambda each: bool(search.new_in(each)))
    ratio = float(np.hypot.reduce(watts)) / max(left, 1e-12)
    return max(most, float(expit(tempered(0.0, odds, ratio))))


def _scales(
    search: EffectSearch,
    chosen: Chosen,
    meters: Sequence[MeterSummary],
    in_set: Sequence[InSet],
    candidates: Sequence[JudgedEffect],
) -> Mapping[str, float]:
    """Probability that each scale is off, over the best set and those that may be in its place.

    Sets with one effect more count, too: a scale may stand in for an effect that is not named.
    """
    by_set = {other.chosen: one.probability(other) for one in in_set for other in one.stand_ins}
    instead = _instead(search, in_set)
    places = {active.key: i for i, active in enumerate(search.actives)}
    by_set |= {
        (*chosen, places[candidate.active.key]): candidate.probability
        for candidate in candidates
        if candidate.active.name not in search.names_of(chosen)
        if candidate.probability > instead.get(candidate.active.name, 0.0)
    }
    weights, found = [1.0], [_scales_of(search, meters)]
    for each, probability in by_set.items():
        if probability >= _WEIGHS:
            own = [search.actives[i] for i in each]
            fitted = zip(search.meters, search.at(each), strict=True)
            summaries = [summarised(m, own, search.known, f.point) for m, f in fitted]
            weights.append(probability / max(1.0 - probability, _RESOLVED))
            found.append(_scales_of(search, summaries))
    return {
        name: float(np.average([own[name] for own in found], weights=weights)) for name in SCALES
    }


def _scales_of(search: EffectSearch, meters: Sequence[MeterSummary]) -> Mapping[str, float]:
    usual = spreads(search.problems[0].signals)
    return {name: max(_scale(name, one, usual) for one in meters) for name in SCALES}


def _scale(name: str, one: MeterSummary, usual: Mapping[str, float]) -> float:
    """Probability that a scale is off, tempered by the discrepancy as effects are.

    The meter's gain and the torque's scale are hardly told apart: of their difference, the one
    that is taken to be larger is stated.
    """
    difference = one.sensors[SCALES[0]] - one.sensors[SCALES[1]]
    larger = max(SCALES, key=lambda each: abs(float(np.mean(one.sensors[each]))))
    values = difference if name == larger else one.sensors[name]
    before = float(logit(SENSORS_OFF * 2.0 * ndtr(-OFF / usual[name])))
    after = float(logit(np.clip(np.mean(np.abs(values) > OFF), _RESOLVED, 1.0 - _RESOLVED)))
    ratio = one.costs[name] / max(one.discrepancy_w, 1e-12)
    return float(expit(tempered(before, after, ratio)))
