"""Log odds of effects: before a recording, and by how much its evidence counts."""

from collections.abc import Collection, Sequence

import numpy as np
from scipy.special import log_ndtr, logit

from power_estimator.effects.fit.design import Active
from power_estimator.posterior.priors import (
    EXPECTED,
    MIMICS,
    MISSING,
    NAMED,
    OF_USERS,
    SHARES,
    TOLD_APART,
    USUAL,
)


def prior_of(name: str, *, expected: bool = False) -> float:
    """Probability that a model without an effect lacks it, before the recording.

    expected: physics asks for it, by the recording's motion and temperature or as the whole of a
    part that the model has.
    """
    usual = MISSING.get(name.partition('@')[0], OF_USERS)
    return max(EXPECTED, usual) if expected else usual


def over_by_share(name: str, other: str, share: float, spread: float) -> float:
    """Log odds of one effect of SHARES over another, by the share that both would take.

    share, spread: mean and standard deviation of what the recording shows.
    """

    def density(mean: float, own: float) -> float:
        variance = own**2 + spread**2
        normal = -0.5 * ((share - mean) ** 2 / variance + np.log(variance))
        # Shares are not negative, before the recording and after it.
        after = (mean * spread**2 + share * own**2) / (own * max(spread, 1e-9) * variance**0.5)
        return float(normal + log_ndtr(after) - log_ndtr(mean / own))

    return density(*SHARES[name]) - density(*SHARES[other])


def has_wholes(parts: Sequence[Active], names: Collection[str]) -> bool:
    """Return whether every effect that one of some is a part of is among names."""
    plain = {name.partition('@')[0] for name in names}
    return {part.effect.part_of for part in parts} - {''} <= plain


def loses_twice(parts: Sequence[Active], *, alone: bool) -> bool:
    """Return whether what flows back is both blocked and lost by a share, of each drive or of all.

    Only of what drives return to one another, their converters lose beside a supply that blocks.
    """
    both = {part.name: part for part in parts if part.name in SHARES}
    if len(both) < 2:
        return False
    limit, lossy = both['regeneration_limit'], both['regeneration_efficiency']
    return alone or limit.per_drive or not lossy.per_drive


def tempered(before: float, after: float, ratio: float) -> float:
    """Log odds between those before and after the evidence.

    ratio: what an effect explains by itself over the discrepancy, W rms over W rms. With little of
    it, the evidence says no more than what was known before; and however long a recording is,
    what no formula explains may look like an effect of a small ratio. Evidence against counts
    whole.
    """
    if after <= before:
        return after
    counts = ratio**2 / (ratio**2 + MIMICS**2)
    most = logit(NAMED) - logit(USUAL) + 2.0 * np.log(max(ratio, 1e-9) / TOLD_APART)
    return before + max(0.0, -float(np.logaddexp(-counts * (after - before), -most)))
