"""Effects of the most probable set against others in their place."""

from collections.abc import Mapping

import numpy as np
from scipy.special import logsumexp

from power_estimator.posterior.search import Chosen, EffectSearch, prior_of, tempered
from power_estimator.posterior.sensors import SCALES
from power_estimator.posterior.summary import MeterSummary, rms

_STAND_INS = 3  # effects that are fitted in the place of one, the most probable as linearised


def odds_of_set(
    search: EffectSearch, chosen: Chosen, summaries: list[MeterSummary]
) -> Mapping[str, float]:
    """
    Log odds of each new effect of the set: against none, and against others in its place.

    Evidence counts by what the effect explains that the other model can't: viscous friction
    is an iron loss beside a torque that reads low.
    """
    left = max(rms(np.array([one.discrepancy_w for one in summaries])), 1e-12)
    here = search.score(chosen)
    out = {}
    for place in chosen:
        if place in search.base:
            continue
        name = search.names[place]
        fewer = tuple(i for i in chosen if i != place)
        own = rms(np.array([float(np.median(one.explains[name])) for one in summaries]))
        chance = prior_of(name)
        before = float(np.log(chance / (1.0 - chance)))
        against = [tempered(before, here - search.score(fewer), own / left)]
        screened = search.screened(search.swaps(chosen, place), chosen)
        best: dict[str, tuple[float, Chosen]] = {}
        for each, score in screened.items():
            (new,) = search.names_of(each) - search.names_of(fewer)
            best[new] = max(best.get(new, (-np.inf, each)), (score, each))
        for new, (_, each) in sorted(best.items(), key=lambda item: -item[1][0])[:_STAND_INS]:
            other = prior_of(new)
            prior = before - float(np.log(other / (1.0 - other)))
            (instead,) = (i for i in each if i not in fewer)
            ratio = _apart_w(search, chosen, place, instead, left) / left
            against.append(tempered(prior, here - search.score(each), ratio))
        out[name] = -float(logsumexp(-np.array(against)))
    return out


def _apart_w(search: EffectSearch, chosen: Chosen, place: int, instead: int, left: float) -> float:
    """
    W rms of an effect that the rest and another in its place can't show, with sensors off.

    A scale that is off by its prior spread costs as much as the discrepancy, left in W rms.
    """
    effect, other = search.actives[place], search.actives[instead]
    rest = [search.actives[i] for i in chosen if i != place]
    sizes = []
    for meter, point in zip(search.meters, search.points, strict=True):
        columns = meter.columns([*rest, effect, other], point)
        places = columns.places(effect)
        values = point[effect.name][1] / columns.watts[places]
        others = np.delete(columns.effects, np.r_[places], axis=1)
        scales = columns.nuisance[:, : len(SCALES)]
        base = np.concatenate([others, scales], axis=1)[meter.used]
        price = np.eye(base.shape[1])[others.shape[1] :] * left * np.sqrt(len(base))
        own = columns.effects[meter.used, places] @ values
        target = np.concatenate([own, np.zeros(len(price))])
        both = np.concatenate([base, price])
        weights, *_ = np.linalg.lstsq(both, target, rcond=None)
        sizes.append(np.sqrt(np.sum(np.square(target - both @ weights)) / len(base)))
    return rms(np.array(sizes))
