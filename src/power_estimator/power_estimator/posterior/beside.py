"""Watts that each effect outside the most probable set would explain beside it."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from wattwalk_core.arrays import Floats

from power_estimator.posterior.effect_columns import explained
from power_estimator.posterior.fitted_set import signs
from power_estimator.posterior.search import Chosen, EffectSearch

_DRAWS = 200


@dataclass(frozen=True)
class Beside:
    """An effect beside the most probable set, linearised about it."""

    place: int  # of its best shape among the effects of the search
    explains: Floats  # W rms [M, 3] at 2.5, 50 and 97.5 %
    gain: float  # nats over the set without it


def all_beside(search: EffectSearch, chosen: Chosen) -> Mapping[str, Beside]:
    """Each effect that the most probable set lacks, beside it."""
    here = search.screened([chosen], chosen)[chosen]
    out = {}
    for name, (score, new, _) in search.best_new(search.more(chosen), chosen, chosen).items():
        levels = [_explained(search, m, chosen, new) for m in range(len(search.meters))]
        out[name] = Beside(new, np.array(levels), score - here)
    return out


def _explained(search: EffectSearch, m: int, chosen: Chosen, new: int) -> Floats:
    """W rms [3] of an effect beside a set, linearised, at the most probable discrepancy."""
    meter, columns = search.meters[m], search.made[m]
    actives = [search.actives[i] for i in (*chosen, new)]
    found = search.linearised(m, actives)
    count = sum(len(active.effect.terms) for active in actives)
    terms = slice(count - len(actives[-1].effect.terms), count)
    mean, covariance = found.mean[terms], found.covariance[terms, terms]
    drawn = np.random.default_rng(0).multivariate_normal(mean, covariance, _DRAWS)
    signed = signs(actives[-1:])
    drawn = np.where(signed, np.maximum(drawn, 0.0), drawn)
    watts = explained(columns, meter.used, actives[-1], drawn, [*search.names_of(chosen)])
    return np.asarray(np.quantile(watts, [0.025, 0.5, 0.975]))
