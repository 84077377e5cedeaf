"""Judgement of prepared signals by the posterior: probabilities, scales, and what is left."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logit, ndtr

from power_estimator.effects import Catalogue
from power_estimator.effects.fit.design import Active, BasePower
from power_estimator.effects.fit.whole_robot import shared_by_size
from power_estimator.effects.signals.prepared import Prepared
from power_estimator.posterior.priors import NAMED, OFF
from power_estimator.posterior.rates import with_quiet_rates
from power_estimator.posterior.search import EffectSearch, tempered
from power_estimator.posterior.sensors import spreads
from power_estimator.posterior.summary import MeterSummary, rms, summarised

Floats = NDArray[np.float64]
SCALES: Final = ('power_gain', 'torque_scale')
_RESOLVED: Final = 0.002  # of some hundred draws


@dataclass(frozen=True)
class JudgedEffects:
    """Probabilities that effects are missing, and what each meter's posterior says."""

    probability: Mapping[str, float]
    scales: Mapping[str, float]  # probability that the meter's gain, the torque's scale is off
    added: tuple[Active, ...]  # the most probable set
    meters: tuple[MeterSummary, ...]
    left_w: float  # rms of the discrepancy

    @property
    def named(self) -> tuple[Active, ...]:
        """Effects that are missing with certainty."""
        return tuple(one for one in self.added if self.probability[one.name] >= NAMED)

    def explains(self, name: str) -> Floats:
        """W rms over the meters at 2.5, 50 and 97.5 % [3]; 0 for an effect that is in no set."""
        if not all(name in one.explains for one in self.meters):
            return np.zeros(3)
        levels = [np.quantile(one.explains[name], [0.025, 0.5, 0.975]) for one in self.meters]
        return np.asarray(np.sqrt(np.mean(np.square(levels), axis=0)))

    def share(self, name: str) -> float:
        """Share of what the model misses that an effect explains, by the square of its watts."""
        misses = sum(self.explains(one.name)[1] ** 2 for one in self.added) + self.left_w**2
        return float(self.explains(name)[1] ** 2 / max(misses, 1e-12))


def judged_effects(
    prepared: Prepared,
    known: Sequence[Active],
    catalogue: Catalogue,
    base: BasePower | None = None,
) -> JudgedEffects:
    """Judge which effects of a catalogue a model of known ones lacks."""
    prepared = replace(prepared, signals=with_quiet_rates(prepared.signals))
    signals = prepared.signals
    names = {active.name.partition('@')[0] for active in known}
    lacking = [
        Active.of(shared_by_size(effect, signals) if prepared.whole else effect, shape)
        for effect in catalogue.physics()
        if effect.name not in names and effect.fixed is None
        for shape in effect.shapes_of(signals.scale)
        # Iron loss whose current heats the winding is friction by another name.
        if effect.usable(signals, **shape) and not shape.get('carried')
    ]
    search = EffectSearch(prepared, known, lacking, base)
    odds, chosen = search.run()
    taken = [search.actives[i] for i in sorted(chosen)]
    meters = tuple(
        summarised(meter, taken, search.known, point)
        for meter, point in zip(search.meters, search.points, strict=True)
    )
    left = rms(np.array([one.discrepancy_w for one in meters]))
    probability = {}
    for name, value in odds.items():
        if all(name in one.explains for one in meters):
            watts = [float(np.median(one.explains[name])) for one in meters]
            value = search.tempered(name, value, rms(np.array(watts)) / max(left, 1e-12))
        probability[name] = float(expit(value))
    usual = spreads(signals)
    scales = {name: max(_scale(name, one, usual) for one in meters) for name in SCALES}
    added = tuple(search.actives[i] for i in sorted(chosen) if i not in search.base)
    return JudgedEffects(probability, scales, added, meters, left)


def _scale(name: str, one: MeterSummary, usual: Mapping[str, float]) -> float:
    """
    Probability that a scale is off, tempered by the discrepancy as effects are.

    The meter's gain and the torque's scale are hardly told apart: of their difference, the one
    that is taken to be larger is stated.
    """
    difference = one.sensors[SCALES[0]] - one.sensors[SCALES[1]]
    larger = max(SCALES, key=lambda each: abs(float(np.mean(one.sensors[each]))))
    values = difference if name == larger else one.sensors[name]
    cost = sum(one.costs[each] for each in SCALES) if name == larger else one.costs[name]
    before = float(logit(2.0 * ndtr(-OFF / usual[name])))
    after = float(logit(np.clip(np.mean(np.abs(values) > OFF), _RESOLVED, 1.0 - _RESOLVED)))
    ratio = cost / max(one.discrepancy_w, 1e-12)
    return float(expit(tempered(before, after, ratio)))
