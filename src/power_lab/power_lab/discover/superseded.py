"""Effects that were found and then superseded by better ones."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.judge.evidence import Evidence
from wattwalk_core.arrays import Floats

from power_lab.discover.found import Found, interval_of
from power_lab.structure.floors import above_floor

Examined = Callable[[Structure, Evidence], Evidence]


def without_superseded(
    found: Sequence[Found], best: Evidence, structure: Structure, examined: Examined, floor: Floats
) -> tuple[list[Found], Evidence]:
    """Effects that the model needs beside each other, the largest first, and the fit with them.

    A course in time may stand for a cause that is found after it, a square for an excess over a
    limit. best: the fit with all of them; structure: of that; floor: W [D].
    """
    kept = list(found)
    for one in found:
        if len(kept) < 2:
            break
        less = structure.without(one.name)
        trial = examined(less, best)
        if not above_floor(trial.mean_mse - best.mean_mse, floor):
            structure, best = less, trial
            kept.remove(one)
    if len(kept) < len(found):
        kept = _judged_anew(kept, best, structure, examined)
    return sorted(kept, key=lambda one: -float(one.gain.sum())), best


def _judged_anew(
    kept: Sequence[Found], best: Evidence, structure: Structure, examined: Examined
) -> list[Found]:
    """The effects with what each explains on top of those before it."""
    for one in kept:
        structure = structure.without(one.name)
    before, out = examined(structure, best), []
    for one in kept:
        assert one.effect is not None
        structure = structure.plus(Active.of(one.effect))
        after = examined(structure, before)
        gain, drives = np.zeros(len(one.gain)), list(one.drives)
        gain[drives] = (before.mean_mse - after.mean_mse)[drives]
        out.append(replace(one, gain=gain, interval=interval_of(before, after, drives, 0)))
        before = after
    return out
