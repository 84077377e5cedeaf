"""Effects of the most probable set against others in their place."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logsumexp
from wattwalk_core.arrays import Floats

from power_estimator.posterior.effect_columns import explained
from power_estimator.posterior.fitted_set import LINEAR_SIZE
from power_estimator.posterior.odds import over_by_share, tempered
from power_estimator.posterior.priors import MIMICS, SHARES
from power_estimator.posterior.search import Chosen, EffectSearch
from power_estimator.posterior.sensors import SCALES
from power_estimator.posterior.summary import MeterSummary, rms

_STAND_INS = 3  # effects that are fitted in the place of one, the most probable as linearised
_SCREENING = 0.5  # of evidence as linearised that, as a rule, is left once both sets are fitted
_SURE = 6.0  # log odds over another, 400 to 1, from which it is not fitted
_HARDLY_EVER = 3.0  # prior spreads
_LEAST_SHOWN = 1e-9  # precision of a share, by which a recording shows nothing of it
_MOST_RATIO = 4.0  # of one meter, at which evidence counts whole


@dataclass(frozen=True)
class LogOdds:
    """Log odds of an effect over none, or over another."""

    before: float  # log odds that were known
    after: float  # log odds by the recording
    ratio: float  # what the effect explains that the others can't, over the discrepancy

    @property
    def over_none(self) -> float:
        """Log odds as far as the evidence counts; against the effect it counts whole."""
        return tempered(self.before, self.after, self.ratio)

    @property
    def over_other(self) -> float:
        """The same, where evidence against the effect is evidence for another."""
        if self.after < self.before:
            return -tempered(-self.before, -self.after, self.ratio)
        return self.over_none


@dataclass(frozen=True)
class Apart:
    """Part of an effect that others can't show."""

    watts: Floats  # W rms by meter [M]
    scatter: float  # variance of its score over blocks, over that of the noise; 1 at least

    def odds(self, before: float, after: float, left: Floats) -> LogOdds:
        """Log odds whose evidence counts by this part; against the effect it counts whole.

        left: discrepancy in W rms by meter [M].
        """
        gain = after - before
        counts = gain / self.scatter if gain > 0.0 else gain
        return LogOdds(before, before + counts, ratio_of(self.watts, left))


@dataclass(frozen=True)
class StandIn:
    """Another effect in the place of one of the most probable set."""

    effect: int
    chosen: Chosen  # the set with it
    against: LogOdds  # for the effect of the set over this one
    alone: LogOdds  # for this one over neither


@dataclass(frozen=True)
class InSet:
    """An effect of the most probable set with all that may stand in its place."""

    place: int
    none: LogOdds  # for the effect over none
    stand_ins: tuple[StandIn, ...]

    @property
    def log_odds(self) -> float:
        """Log odds that it is missing."""
        against = [self.none.over_none, *map(self._over, self.stand_ins)]
        return -float(logsumexp([-one for one in against]))

    def probability(self, other: StandIn) -> float:
        """Probability of the other in its place."""
        total = float(logsumexp([0.0, -self.log_odds]))
        return float(np.exp(-self._over(other) - total))

    def _over(self, other: StandIn) -> float:
        """Log odds over another, which gains no more on none of them than its own evidence."""
        # As much as it can take over of the effect, it explains alone.
        shared = np.sqrt(max(self.none.ratio**2 - other.against.ratio**2, 0.0))
        alone = replace(other.alone, ratio=max(other.alone.ratio, shared))
        least = self.none.over_none - alone.over_none
        return max(other.against.over_other, least)


def judged_set(
    search: EffectSearch, chosen: Chosen, summaries: Sequence[MeterSummary]
) -> list[InSet]:
    """Judge each new effect of a set against none, and against others in its place.

    Evidence counts by what the effect explains that the other model can't: viscous friction is an
    iron loss beside a torque that reads low.
    """
    left = np.array([max(one.discrepancy_w, 1e-12) for one in summaries])
    here, out = search.score(chosen), []
    screened = search.screened([chosen], chosen)[chosen]
    places = search.new_in(chosen)
    search.fit([tuple(i for i in chosen if i != place) for place in places])
    for place in places:
        name = search.names[place]
        fewer = tuple(i for i in chosen if i != place)
        without = _without(search, chosen, fewer)
        own = _apart(search, chosen, place, None, left)
        before = search.prior_odds(name)
        none = own.odds(before, here - without, left)
        best = search.best_new(search.swaps(chosen, place), fewer, chosen)
        likely = []
        for score, new, each in sorted(best.values(), reverse=True)[:_STAND_INS]:
            known = before - search.prior_odds(search.names[new])
            known += _by_share(search, chosen, name, search.names[new])
            apart = _apart(search, chosen, place, new, left)
            linear = known + _SCREENING * (screened - score - known)
            if apart.odds(known, linear, left).over_other < _SURE:
                likely.append((new, each, known, apart))
        search.fit([each for _, each, _, _ in likely])
        stand_ins = []
        for new, each, known, apart in likely:
            fitted = search.score(each)
            ratio = ratio_of(_explained_w(search, each, new), left)
            alone = LogOdds(search.prior_odds(search.names[new]), fitted - without, ratio)
            against = apart.odds(known, here - fitted, left)
            stand_ins.append(StandIn(new, each, against, alone))
        out.append(InSet(place, none, tuple(stand_ins)))
    return out


def _without(search: EffectSearch, chosen: Chosen, fewer: Chosen) -> float:
    """Log posterior of a set of fewer effects, a known one in its best other shape if need be."""
    scores = [search.score(fewer)]
    if others := search.reshaped(fewer, [i for i in fewer if search.names[i] in search.known]):
        screened = search.screened(others, chosen)
        scores.append(search.score(max(others, key=lambda each: screened[each])))
    return max(scores)


def _by_share(search: EffectSearch, chosen: Chosen, name: str, other: str) -> float:
    """Log odds of an effect of a set over another by the share that both take."""
    if search.underneath or name not in SHARES or other not in SHARES:
        return 0.0
    actives = [search.actives[i] for i in chosen]
    own = [active.name for active in actives].index(name)
    place = sum(len(active.effect.terms) for active in actives[:own])
    total = 0.0
    for m, columns in enumerate(search.made):
        found = search.linearised(m, actives)
        unit = columns.watts[columns.places(actives[own])][0]
        # What is left without the prior of sets that are screened.
        shown = 1.0 / found.covariance[place, place] - LINEAR_SIZE**-2.0
        if shown > _LEAST_SHOWN:
            share = unit * found.mean[place] * (1.0 + LINEAR_SIZE**-2.0 / shown)
            total += over_by_share(name, other, share, unit / np.sqrt(shown))
    return search.pooled * total


def _explained_w(search: EffectSearch, chosen: Chosen, place: int) -> Floats:
    """W rms of an effect that known effects and the gain can't take over, by meter [M]."""
    actives, name = [search.actives[i] for i in chosen], search.names[place]
    sizes = []
    for meter, fitted in zip(search.meters, search.at(chosen), strict=True):
        columns = meter.columns(actives, fitted.point)
        active, values = fitted.point[name]
        units = (values / columns.watts[columns.places(active)])[None]
        sizes.append(float(explained(columns, meter.used, active, units, search.known)[0]))
    return np.array(sizes)


def ratio_of(own: Floats, left: Floats) -> float:
    """Watts of an effect over the discrepancy, both W rms by meter [M]: rms over meters."""
    return rms(np.minimum(own / left, _MOST_RATIO))


def _apart(
    search: EffectSearch, chosen: Chosen, place: int, instead: int | None, left: Floats
) -> Apart:
    """What the rest, and another in its place, can't show of an effect.

    Scales of sensors that are off by three spreads, which is hardly ever, cost as much as a ratio
    to the discrepancy (left in W rms) at which evidence counts half.
    """
    effect = search.actives[place]
    rest = [search.actives[i] for i in chosen if i != place]
    rest += [] if instead is None else [search.actives[instead]]
    sizes, scatter = [], np.zeros(2)
    for m, (meter, size) in enumerate(zip(search.meters, left, strict=True)):
        columns = search.made[m].taken([*rest, effect])
        places = columns.places(effect)
        values = search.points[m][effect.name][1] / columns.watts[places]
        others = np.delete(columns.effects, np.r_[places], axis=1)
        scales = columns.nuisance[:, : len(SCALES)]
        base = np.concatenate([others, scales], axis=1)[meter.used]
        price = np.eye(base.shape[1])[others.shape[1] :]
        price *= MIMICS * size / _HARDLY_EVER * np.sqrt(len(base))
        own = columns.effects[meter.used, places] @ values
        target = np.concatenate([own, np.zeros(len(price))])
        both = np.concatenate([base, price])
        weights, *_ = np.linalg.lstsq(both, target, rcond=None)
        sizes.append(np.sqrt(np.sum(np.square(target - both @ weights)) / len(base)))
        scatter += meter.scatter(columns, places, values)
    return Apart(np.array(sizes), max(1.0, float(scatter[0] / max(scatter[1], 1e-12))))
