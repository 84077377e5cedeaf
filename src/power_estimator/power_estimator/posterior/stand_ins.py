"""Effects of the most probable set against others in their place."""

from collections.abc import Mapping

import numpy as np
from scipy.special import logsumexp

from power_estimator.posterior.meter import apart
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
            ratio = _apart_w(search, chosen, place, instead) / left
            against.append(tempered(prior, here - search.score(each), ratio))
        out[name] = -float(logsumexp(-np.array(against)))
    return out


def _apart_w(search: EffectSearch, chosen: Chosen, place: int, instead: int) -> float:
    """W rms of an effect that the rest, another in its place and scales of sensors can't show."""
    effect, other = search.actives[place], search.actives[instead]
    rest = [search.actives[i] for i in chosen if i != place]
    sizes = []
    for meter, point in zip(search.meters, search.points, strict=True):
        columns = meter.columns([*rest, effect, other], point)
        names = [active.name for active in (*rest, other)]
        places = columns.places(effect)
        own = apart(columns, meter.used, places, names, len(SCALES))
        values = point[effect.name][1] / columns.watts[places]
        sizes.append(rms(own[meter.used] @ values))
    return rms(np.array(sizes))
