"""Names by the posterior of effects, which stand beside what no effect explains."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from power_estimator.effects import Catalogue
from power_estimator.effects.fit.design import Active
from power_estimator.effects.training import Material
from power_estimator.posterior.judged import JudgedEffects, judged_effects
from power_estimator.posterior.priors import NAMED, OFF

from power_lab.diagnose.diagnosis import Diagnoser
from power_lab.diagnose.findings import Diagnosis, Step
from power_lab.diagnose.measurement_check import MeasurementTerm

MOST_METERS: Final = 2
"""
Meters of which the posterior judges.

Of one drive 20 of 21 names were true, of public logs 26 of 26 (docs/results/reliability.md); of
twelve drives, whose formulas fail alike, iron loss stood for viscous friction.
"""


def probable(
    material: Material, known: Sequence[Active], catalogue: Catalogue, window: float
) -> JudgedEffects | None:
    """Judge by the posterior; None for more meters, operating points or a slow meter."""
    prepared = material.prepared
    if len(prepared.names) > MOST_METERS or prepared.steady or window:
        return None
    return judged_effects(prepared, known, catalogue, material.base_power)


def with_names(diagnosis: Diagnosis, found: JudgedEffects, diagnoser: Diagnoser) -> Diagnosis:
    """
    Take the posterior's names, where it has some that make the held-out error smaller.

    What else the model misses stays beside them as what no effect explains.
    """
    names = tuple(active.name for active in found.named)
    if not names or names == diagnosis.effects:
        return diagnosis
    none = diagnosis.base
    best = diagnoser.added(none.fit, found.named)
    gain = none.mean_mse - best.mean_mse
    if gain.sum() <= 0.0:
        return diagnosis
    unexplained = diagnoser.unexplained(best)
    explained = np.maximum(gain, 0.0)
    share = float(explained.sum() / max((explained + unexplained.explained).sum(), 1e-12))
    return replace(
        diagnosis,
        verdict='named',
        effects=names,
        best=best,
        chosen=names,
        in_set=frozenset(names),
        certain=frozenset(names),
        possible=(names,),
        ladder=(none, best),
        explained=explained,
        unexplained=unexplained,
        share=share,
        steps=(Step(names, (names,), False, names, gain),),
        beside=None,
    )


def torque_scale(found: JudgedEffects, names: Sequence[str]) -> MeasurementTerm:
    """Error of the torque's scale, of the drive where it costs most."""
    drawn = [one.sensors['torque_scale'] for one in found.meters]
    costs = [one.costs['torque_scale'] for one in found.meters]
    worst = int(np.argmax(costs))
    low, high = (float(f'{end:.5g}') for end in np.quantile(drawn[worst], [0.025, 0.975]))
    means = [float(f'{np.mean(own):.5g}') for own in drawn]
    off = found.scales['torque_scale'] >= NAMED and abs(means[worst]) > OFF
    return MeasurementTerm(
        'torque_scale',
        means[worst],
        (low, high),
        costs[worst],
        off,
        names[worst],
        dict(zip(names, means, strict=True)),
    )
