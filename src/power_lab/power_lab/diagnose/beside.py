"""Effects beside structure that no effect explains: free shapes over it compete and stay."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from power_estimator.effects.fit.design import Active
from power_estimator.effects.fit.fitter import Fit, Fitter
from power_estimator.judge.evidence import Evidence, Examiner

from power_lab.diagnose.findings import Diagnosis
from power_lab.diagnose.free_shapes import Remainder, remainder
from power_lab.diagnose.residual_structure import ResidualStructure
from power_lab.structure.floors import above_floor

Floats = NDArray[np.float64]

MOST_SHAPES = 3
BESIDE_SHARE = 0.15
"""
An effect must explain this share, in watts, of what free shapes beside it explain: they follow
what is there to about a fiftieth of its square.
"""


class FitsOfBase(Protocol):
    """Fits of the base that is diagnosed."""

    fitter: Fitter
    examiner: Examiner
    structure_floor: Floats

    def added(self, start: Fit, actives: Sequence[Active], iterations: int = 3) -> Evidence:
        """The base with effects added."""

    def unexplained(self, evidence: Evidence) -> ResidualStructure:
        """Structure that is left."""


def beside(
    found: Diagnosis, bench: FitsOfBase, again: Callable[[Sequence[Active]], Diagnosis]
) -> Diagnosis:
    """
    Say what structure depends on that no effect explains, and name effects beside it.

    Where the known effects explain too little to be named, what the residual depends on most gets
    a free shape in the base, and all is diagnosed again. An effect that is named there has won
    against all others and the unchanged model with the shape in each of them, so that it does not
    stand for the unmodelled one. again: diagnoses the base with shapes.
    """
    if found.verdict == 'no_evidence':
        return found
    best = found.base if found.verdict == 'none_of_the_above' else found.best
    first = _remainder(bench, best, 0) if found.unmodelled else None
    if first is None:
        return found
    described = replace(found, remainder=first)
    if found.verdict != 'none_of_the_above':
        return described
    shapes: tuple[Active, ...] = ()
    last: Remainder | None = first
    while last is not None and last.shape is not None and len(shapes) < MOST_SHAPES:
        shapes = (*shapes, Active.of(last.shape))
        trial = again(shapes)
        if trial.verdict in ('named', 'ambiguous'):
            return _joined(described, trial, bench)
        if trial.verdict == 'no_evidence':
            break
        last = _remainder(bench, trial.best, len(shapes))
    return described


def _remainder(bench: FitsOfBase, evidence: Evidence, number: int) -> Remainder | None:
    return remainder(
        bench.fitter, bench.examiner, evidence, bench.structure_floor, f'free_shape_{number + 1}'
    )


def _joined(found: Diagnosis, trial: Diagnosis, bench: FitsOfBase) -> Diagnosis:
    """The diagnosis of the base with the names that were found beside free shapes."""
    assert found.remainder is not None
    alone = bench.added(found.base.fit, trial.best.actives)
    left = np.maximum(alone.mean_mse - trial.best.mean_mse, 0.0) + trial.unexplained.explained
    explained = trial.explained
    large = explained.sum() >= BESIDE_SHARE**2 * left.sum()
    if not large or not above_floor(explained, bench.structure_floor):
        return found
    return replace(
        trial,
        base=found.base,
        best=alone,
        ladder=(found.base, alone),
        unexplained=bench.unexplained(alone),
        share=float(explained.sum() / max((explained + left).sum(), 1e-12)),
        remainder=replace(found.remainder, gain=left),
        beside=trial,
    )
