"""The judge: a recording's statements with their probabilities, and intervals of coefficients."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from judgements import LEVELS, Interval, Judgement, Statement
from numpy.typing import NDArray
from power_estimator.effects import builtin_catalogue
from power_estimator.effects.fit.design import Active
from power_estimator.effects.fit.whole_robot import expanded, shared_by_size
from power_estimator.effects.signals.pieces import pieces
from power_estimator.effects.signals.prepared import prepare
from power_recordings.alignment.dataset import AlignedDataset
from scipy.special import expit, logit, ndtr

from discrepancy.priors import MIMICS, NAMED, OFF
from discrepancy.rates import with_quiet_rates
from discrepancy.search import EffectSearch
from discrepancy.sensors import spreads
from discrepancy.summary import MeterSummary, summarised

Floats = NDArray[np.float64]
CATALOGUE: Final = builtin_catalogue()
COEFFICIENTS: Final = {
    'copper_loss': 'k',
    'rotor_inertia': 'inertia',
    'idle': 'idle',
    'spring': 'spring',
    'load_friction': 'load_friction',
}
SCALES: Final = ('power_gain', 'torque_scale')
_MOST_SECONDS: Final = 150.0
_RESOLVED: Final = 0.002  # of some hundred draws


def judged(data: AlignedDataset, known: Sequence[str]) -> Judgement:
    """Judge a recording: probabilities of missing effects, and intervals of coefficients."""
    prepared = prepare(data)
    if prepared.seconds > _MOST_SECONDS:
        prepared = pieces(prepared, _MOST_SECONDS)
    prepared = replace(prepared, signals=with_quiet_rates(prepared.signals))
    signals = prepared.signals
    actives: Sequence[Active] = [
        Active.of(CATALOGUE[name]) for name in known if CATALOGUE[name].usable(signals)
    ]
    lacking: Sequence[Active] = [
        Active.of(shared_by_size(effect, signals) if prepared.whole else effect, shape)
        for effect in CATALOGUE.physics()
        if effect.name not in known and effect.fixed is None
        for shape in effect.shapes_of(signals.scale)
        # Iron loss whose current heats the winding is friction by another name.
        if effect.usable(signals, **shape) and not shape.get('carried')
    ]
    if prepared.whole:
        actives = expanded(actives, signals)
    search = EffectSearch(prepared, actives, lacking)
    odds, chosen = search.run()
    taken = [search.actives[i] for i in sorted(chosen)]
    drives = [
        summarised(meter, taken, search.known, point)
        for meter, point in zip(search.meters, search.points, strict=True)
    ]
    left = np.sqrt(np.mean([_rms(one.discrepancy) ** 2 for one in drives]))
    probability = {}
    for name, value in odds.items():
        if all(name in one.explains for one in drives):
            watts = [float(np.median(one.explains[name])) for one in drives]
            value = search.tempered(name, value, _rms(np.array(watts)) / max(left, 1e-12))
        probability[name] = float(expit(value))
    usual = spreads(signals)
    probability |= {n: max(_scale(n, one, usual) for one in drives) for n in SCALES}
    named = sorted(name for name, chance in probability.items() if chance >= NAMED)
    return Judgement(
        tuple(Statement(name, chance) for name, chance in probability.items()),
        tuple(
            interval
            for name, one in zip(prepared.names, drives, strict=True)
            for interval in _intervals(name, one)
        ),
        ' '.join(named) or 'nothing named',
    )


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
    ratio = cost / max(_rms(one.discrepancy), 1e-12)
    counts = ratio**2 / (ratio**2 + MIMICS**2)
    return float(expit(before + counts * (after - before) if after > before else after))


def _intervals(drive: str, one: MeterSummary) -> list[Interval]:
    drawn = {COEFFICIENTS[e]: v[:, 0] for e, v in one.coefficients.items() if e in COEFFICIENTS}
    if one.friction_at_1 is not None:
        drawn['friction_at_1'] = one.friction_at_1
    return [
        Interval(drive, name, level, *np.quantile(values, [0.5 - level / 2, 0.5 + level / 2]))
        for name, values in drawn.items()
        for level in LEVELS
    ]


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
