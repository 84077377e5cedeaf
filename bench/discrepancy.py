"""
The posterior of effects as a judge in the benchmark of reliability.

python bench/reliability.py --judge discrepancy:judged --families … --out FILE.jsonl
"""

from collections.abc import Sequence

import numpy as np
from judgements import COEFFICIENTS, LEVELS, Interval, Judgement, Statement
from power_estimator.effects import builtin_catalogue
from power_estimator.effects.fit.design import Active
from power_estimator.effects.fit.whole_robot import expanded
from power_estimator.effects.signals.pieces import pieces
from power_estimator.effects.signals.prepared import prepare
from power_estimator.posterior.judged import judged_effects
from power_estimator.posterior.summary import MeterSummary
from power_lab.diagnose.outcome import MOST_SECONDS
from power_recordings.alignment.dataset import AlignedDataset


def judged(data: AlignedDataset, known: Sequence[str]) -> Judgement:
    """Judge a recording: probabilities of missing effects, and intervals of coefficients."""
    catalogue, prepared = builtin_catalogue(), prepare(data)
    if prepared.seconds > MOST_SECONDS:
        prepared = pieces(prepared, MOST_SECONDS)
    effects = [catalogue[name] for name in known]
    actives: Sequence[Active] = [
        Active.of(effect) for effect in effects if effect.usable(prepared.signals)
    ]
    if prepared.whole:
        actives = expanded(actives, prepared.signals)
    found = judged_effects(prepared, actives, catalogue)
    statements = {**found.probability, **found.scales}
    named = ' '.join(sorted(active.name for active in found.named))
    return Judgement(
        tuple(Statement(name, chance) for name, chance in statements.items()),
        tuple(
            interval
            for name, one in zip(prepared.names, found.meters, strict=True)
            for interval in _intervals(name, one)
        ),
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
