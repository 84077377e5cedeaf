"""Log odds of effects: before a recording, and by how much its evidence counts."""

import numpy as np
from scipy.special import logit

from power_estimator.posterior.priors import (
    MIMICS,
    MISSING,
    NAMED,
    OF_USERS,
    TOLD_APART,
    USUAL,
    WARMING,
)


def prior_of(name: str, *, warms: bool = False) -> float:
    """Probability that a model without an effect lacks it, before the recording.

    warms: a winding's temperature was seen to move so far that its loss has to show it.
    """
    plain = name.partition('@')[0]
    if warms and plain == 'winding_heating':
        return WARMING
    return MISSING.get(plain, OF_USERS)


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
