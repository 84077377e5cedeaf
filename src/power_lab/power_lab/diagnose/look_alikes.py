"""Sets of effects that formulas are not exact enough to tell from the chosen one."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from power_estimator.effects.effect import Effect
from power_estimator.effects.fit.design import Active
from power_estimator.judge.evidence import Evidence

from power_lab.structure.floors import above_floor, beyond_physics

Floats = NDArray[np.float64]

AS_MUCH = 0.95
"""Share of what an effect explains, squared, that a look-alike in its place explains too."""


def look_alikes(
    none: Evidence,
    best: Evidence,
    others: Sequence[Active],
    added: Callable[[Sequence[Active]], Evidence],
    floor: Floats,
) -> tuple[tuple[str, ...], ...]:
    """
    Names of the sets that a recording does not tell from the best one.

    In each, an effect that the catalogue calls near takes the place of one effect, or of all that
    it is near to: hysteresis in the iron for Coulomb friction, iron loss for both frictions. The
    confidence set may decide between such sets by hundredths of a watt; formulas are only as
    exact as the floor. none: the base alone; others: candidates that are not in the best set;
    added: fits the base with effects; floor: W [D], of structure that formulas leave.
    """
    sets: dict[tuple[str, ...], None] = {}
    for other in others:
        near = [active for active in best.actives if _near(active.effect, other.effect)]
        replaced = [[active] for active in near] + ([near] if len(near) > 1 else [])
        for out in replaced:
            kept = [active for active in best.actives if active not in out]
            trial = added([*kept, other])
            worse = trial.mean_mse - best.mean_mse
            if above_floor(worse, floor) or beyond_physics(trial):
                continue
            without = added(kept) if kept else none
            explained = (without.mean_mse - best.mean_mse).sum()
            if worse.sum() <= (1.0 - AS_MUCH) * explained:
                sets[trial.names] = None
    return tuple(sets)


def _near(one: Effect, other: Effect) -> bool:
    """Return whether another effect may be taken for one; heating is none without copper loss."""
    either = one.name in other.near or other.name in one.near
    return either and one.name not in other.rests_on
