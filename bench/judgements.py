"""Judgements that the benchmark of reliability scores, and the lab as one that judges.

A judge is a function (AlignedDataset, effects of the base model, window in s over which energy is
judged) -> Judgement; the benchmark takes any by `--judge module:function`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from power_estimator.effects import builtin_catalogue
from power_estimator.effects.fit.design import Active
from power_estimator.effects.training import material
from power_estimator.posterior.judged import judged_effects
from power_estimator.posterior.priors import MOST_SECONDS
from power_estimator.posterior.summary import MeterSummary
from power_recordings.alignment.dataset import AlignedDataset

LEVELS = (0.5, 0.8, 0.95)
OR = ' or '
"""Between effects of which one is missing."""


class Interval(NamedTuple):
    """Claim that a coefficient of a drive lies between two values."""

    drive: str
    coefficient: str  # as in `truths`: k, inertia, idle, spring, friction_at_1, load_friction, …
    level: float  # 0.5, 0.8 or 0.95
    low: float
    high: float


@dataclass(frozen=True)
class Judgement:
    """Everything that a judge says of a recording.

    statements: probabilities that the model lacks an effect of the catalogue, or an error of the
    measurement (torque_scale, power_gain, current_offset, torque_bias); 0 for those not named.
    Effects with OR between them: that one of them is missing.
    """

    statements: Mapping[str, float]
    intervals: Sequence[Interval]
    words: str = ''  # verdict, for the reader


COEFFICIENTS = {
    'copper_loss': 'k',
    'rotor_inertia': 'inertia',
    'idle': 'idle',
    'spring': 'spring',
    'load_friction': 'load_friction',
}


def diagnosed(data: AlignedDataset, known: Sequence[str], window: float = 0.0) -> Judgement:
    """Judge by the posterior of `power_lab diagnose`, without its held-out errors.

    known: effects of the base. window: as in `material`, of a slow meter. Intervals are at LEVELS.
    """
    catalogue = builtin_catalogue()
    given = material(data, per='drive', window=window).at_most(MOST_SECONDS)
    prepared = given.prepared
    actives = [Active.of(catalogue[name]) for name in known]
    actives = [active for active in actives if active.effect.usable(prepared.signals)]
    found = judged_effects(prepared, given.structure(actives).actives, catalogue)
    named = ' '.join(sorted(active.name for active in found.named))
    return Judgement(
        {
            **found.probability,
            **found.scales,
            **{OR.join(one.names): one.probability for one in found.undecided},
        },
        [
            interval
            for name, one in zip(prepared.names, found.meters, strict=True)
            for interval in _intervals(name, one)
        ],
        named or 'nothing named',
    )


def _intervals(drive: str, one: MeterSummary) -> list[Interval]:
    drawn = {COEFFICIENTS[e]: v[:, 0] for e, v in one.coefficients.items() if e in COEFFICIENTS}
    if one.friction_at_1 is not None:
        drawn['friction_at_1'] = one.friction_at_1
    return [
        Interval(drive, name, level, *np.quantile(values, [0.5 - level / 2, 0.5 + level / 2]))
        for name, values in drawn.items()
        for level in LEVELS
    ]
