"""Watts that each effect outside the most probable set would explain beside it."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from wattwalk_core.arrays import Floats

from power_estimator.posterior.fitted_set import signs
from power_estimator.posterior.meter import apart
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
    screened = search.screened([*search.more(chosen), chosen], chosen)
    here = screened.pop(chosen)
    best: dict[str, tuple[float, int]] = {}
    for each, score in screened.items():
        (new,) = (i for i in each if i not in chosen)
        best[search.names[new]] = max(best.get(search.names[new], (-np.inf, new)), (score, new))
    out = {}
    for name, (score, new) in best.items():
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
    alone = apart(columns, meter.used, columns.places(actives[-1]), [*search.names_of(chosen)])[
        meter.used
    ]
    gram = alone.T @ alone / len(alone)
    watts = np.sqrt(np.maximum(np.einsum('si,ij,sj->s', drawn, gram, drawn), 0.0))
    return np.asarray(np.quantile(watts, [0.025, 0.5, 0.975]))
