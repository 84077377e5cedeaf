"""Outcome of a diagnosis: verdict, candidates and the steps that led there."""

from collections.abc import Collection
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from power_estimator.effects.fit.design import Active
from power_estimator.judge.evidence import Evidence

from power_lab.diagnose.free_shapes import Remainder
from power_lab.diagnose.residual_structure import ResidualStructure
from power_lab.structure.floors import above_floor

Floats = NDArray[np.float64]
Verdict = Literal['named', 'ambiguous', 'none_of_the_above', 'no_evidence']


@dataclass(frozen=True)
class Candidate:
    """One effect on top of the base."""

    name: str
    active: Active
    evidence: Evidence
    gain: Floats  # W² [D], held-out
    columns: NDArray[np.float32]  # [N, D, n], of its coefficients
    intervals: Floats  # [D, n, 2], of its coefficients
    explained: NDArray[np.float32]  # W [N, D], that the base's residual has more than its own


@dataclass(frozen=True)
class Step:
    """One round: what competed for the next place, and what could have it."""

    added: tuple[str, ...]
    members: tuple[tuple[str, ...], ...]  # sets of effects that may be the best
    none_possible: bool
    best: tuple[str, ...]
    gain: Floats  # W² [D], of the best over what was there before

    def less(self, redundant: Collection[str]) -> 'Step':
        """Without effects that proved superfluous beside the others."""
        if not redundant:
            return self
        left = [tuple(name for name in member if name not in redundant) for member in self.members]
        return replace(self, members=tuple(dict.fromkeys(left)))


@dataclass(frozen=True)
class Diagnosis:
    """The verdict with everything it rests on."""

    verdict: Verdict
    effects: tuple[str, ...]
    base: Evidence
    best: Evidence  # with the effects that the data ask for
    chosen: tuple[str, ...]
    singles: tuple[Candidate, ...]
    in_set: frozenset[str]
    certain: frozenset[str]  # in every set that may be the best
    possible: tuple[tuple[str, ...], ...]  # sets that may be missing, where something is named
    ladder: tuple[Evidence, ...]  # the base, and what the data asked for step by step
    explained: Floats  # W² [D], by the chosen effects
    unexplained: ResidualStructure
    floor: Floats  # W [D], of what is worth a name
    structure_floor: Floats  # W [D]
    share: float
    steps: tuple[Step, ...] = field(default=())
    beyond: tuple[str, ...] = ()  # effects that only fit with a coefficient at its bound
    noise: Floats = field(default_factory=lambda: np.zeros(0))  # W [D], of the meters
    remainder: Remainder | None = None  # of structure that no effect explains
    beside: 'Diagnosis | None' = None  # the same with free shapes in the base, where they decided

    @property
    def unmodelled(self) -> bool:
        """True if structure is left that is large enough to be an unmodelled effect."""
        return above_floor(self.unexplained.explained, self.structure_floor)
