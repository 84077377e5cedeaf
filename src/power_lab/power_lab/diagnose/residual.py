"""Power that stays unexplained beside what is named."""

import numpy as np
from power_estimator.effects.signals.prepared import Prepared
from power_estimator.judge.evidence import Evidence
from power_estimator.posterior.judged import JudgedEffects
from power_estimator.posterior.priors import OFF
from wattwalk_core.arrays import Floats

from power_lab.diagnose.findings import Residual
from power_lab.structure.floors import unseen

_ALONE = 2.0  # times the least residual, on one meter alone
_ACCOUNTED, _MENTIONED = 0.25, 0.1  # of the squared residual, of the largest cause
_MOST_CAUSES = 3
_OF_FORMULAS = 'departures of'  # causes that are an effect's departure from its formula


def missed_w2(evidence: Evidence, prepared: Prepared) -> Floats:
    """Squared held-out error of a model, W² [M], without what no model can follow.

    That is the meter's noise, and what the joint signals do between two samples.
    """
    by_chance = np.square(np.nan_to_num(prepared.noise))
    if not prepared.steady:
        by_chance = by_chance + np.square(unseen(prepared, evidence.fit))
    return np.asarray(np.maximum(evidence.mean_mse - by_chance, 0.0))


def residual(
    found: JudgedEffects, base: Evidence, best: Evidence, prepared: Prepared
) -> Residual | None:
    """Error that stays with the names.

    None below what a good sensor's scale is off by, of the rms power: on average over the meters,
    or twice that on one alone.
    """
    left = missed_w2(best, prepared)
    missed = np.maximum(missed_w2(base, prepared), left)
    share = left / np.maximum(np.nanmean(np.square(prepared.power_at(0.0)), axis=0), 1e-12)
    if share.mean() < OFF**2 and share.max() < (_ALONE * OFF) ** 2:
        return None
    known = prepared.noise[np.isfinite(prepared.noise)]
    return Residual(
        rms_w=float(np.sqrt(left.mean())),
        share=float(left.sum() / max(missed.sum(), 1e-12)),
        over=_causes(found, left, prepared),
        noise_w=float(np.sqrt(np.mean(np.square(known)))) if known.size else float('nan'),
        drives=dict(zip(prepared.names, np.sqrt(left).tolist(), strict=True)),
    )


def _causes(found: JudgedEffects, left: Floats, prepared: Prepared) -> tuple[str, ...]:
    """Causes of the discrepancy, largest first, where they account for the residual, W² [M]."""
    sizes: dict[str, list[float]] = {}
    for one in found.meters:
        for cause, watts in one.left.items():
            if not cause.startswith(_OF_FORMULAS):
                sizes.setdefault(cause, []).append(watts)
    pooled = {cause: sum(watts**2 for watts in own) for cause, own in sizes.items()}
    if not pooled or sum(pooled.values()) < _ACCOUNTED * left.sum():
        return ()
    order = sorted(pooled, key=lambda cause: -pooled[cause])[:_MOST_CAUSES]
    shown = [cause for cause in order if pooled[cause] >= _MENTIONED * pooled[order[0]]]
    if len(left) < 2:
        return tuple(shown)
    worst = {cause: prepared.names[int(np.argmax(sizes[cause]))] for cause in shown}
    return tuple(cause if cause == 'time' else f'{cause} of {worst[cause]}' for cause in shown)
