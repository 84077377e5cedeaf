"""Log odds of effects: before a recording, and by how much its evidence counts."""

import numpy as np
from scipy.special import logit

from power_estimator.posterior.priors import MIMICS, MISSING, NAMED, OF_USERS, TOLD_APART


def prior_of(name: str) -> float:
    """Probability that a model without an effect lacks it, before the recording."""
    return MISSING.get(name.partition('@')[0], OF_USERS)


def prior_odds(name: str) -> float:
    """Log odds that a model without an effect lacks it, before the recording."""
    return float(logit(prior_of(name)))


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
    found = before + counts * (after - before)
    most = logit(NAMED) + 2.0 * np.log(max(ratio, 1e-9) / TOLD_APART)
    return max(before, -float(np.logaddexp(-found, -most)))
