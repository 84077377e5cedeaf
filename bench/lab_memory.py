"""
Results of a diagnosis that are kept while its constants change, for bench/lab_constants.py.

A diagnosis is made of fits, held-out errors and tests that are functions of what they are given.
Where a constant only decides what follows from them, they are not computed again.
"""

import importlib
import sys
import time
from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from power_estimator.effects.fit import candidate_screener
from power_estimator.effects.fit.candidate_screener import CandidateScreener, Screened, Trial
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.effects.fit.fitter import Fit, Fitter
from power_estimator.judge.evidence import Evidence, Examiner
from power_lab.diagnose import confidence_set as statistics
from power_lab.diagnose import diagnosis as procedure
from power_lab.diagnose import residual_structure
from power_lab.diagnose.diagnosis import Diagnoser

Key = tuple[Hashable, ...]


class Memory:
    """Results by what they were computed from, with the CPU time that each took."""

    def __init__(self) -> None:
        self._values: dict[Key, tuple[Any, float, Any]] = {}
        self._credit = 0.0  # s, of results that were there

    def clock(self) -> float:
        """CPU s, as if nothing were kept."""
        return time.process_time() + self._credit

    def get(self, key: Key, make: Callable[[], Any], given: Any = None) -> Any:
        """Return what make returns; given is what the key's identities are of, kept alive."""
        if key in self._values:
            value, cost, _ = self._values[key]
            self._credit += cost
            return value
        start = self.clock()
        value = make()
        self._values[key] = (value, self.clock() - start, given)
        return value


def active_key(active: Active) -> Hashable:
    """Identity of an effect in its shape; discrepancies are made anew for each fit."""
    return active.effect.departs_from or id(active.effect), active.shape


def structure_key(structure: Structure) -> Key:
    """Identity of the effects of a structure, in order."""
    return tuple(active_key(active) for active in structure.actives)


def _blocks_key(fitter: Fitter) -> Key:
    return id(fitter.prepared), hash(fitter.blocks.valid.tobytes())


class KeptScreener(CandidateScreener):
    """Candidate screener that screens each subset once."""

    memory: Memory

    def fitted(self, subsets: Sequence[Sequence[Active]]) -> list[Trial]:
        """Each subset fitted to everything; its share of the time is that of all."""
        return self._each('fitted', subsets, lambda s: tuple(map(active_key, s)), super().fitted)

    def tested(self, trials: Sequence[Trial]) -> list[Screened]:
        """Held-out errors of what was fitted."""
        return self._each('tested', trials, id, super().tested)

    def _each(
        self,
        what: str,
        items: Sequence[Any],
        name: Callable[[Any], Hashable],
        make: Callable[[list[Any]], list[Any]],
    ) -> list[Any]:
        memory = self.memory
        keys: list[Key] = [(what, id(self), name(item)) for item in items]
        values = memory._values
        missing = {k: item for k, item in zip(keys, items, strict=True) if k not in values}
        memory._credit += sum(values[key][1] for key in keys if key in values)
        start = memory.clock()
        made = make(list(missing.values())) if missing else []
        cost = (memory.clock() - start) / max(len(missing), 1)
        for (key, item), value in zip(missing.items(), made, strict=True):
            values[key] = value, cost, (self, item)
        return [values[key][0] for key in keys]


@contextmanager
def replaced(pairs: Sequence[tuple[object, str, Any]]) -> Iterator[None]:
    """Set attributes of modules or classes, and put them back."""
    before = [(owner, name, getattr(owner, name)) for owner, name, _ in pairs]
    try:
        for owner, name, value in pairs:
            setattr(owner, name, value)
        yield
    finally:
        for owner, name, value in before:
            setattr(owner, name, value)


def everywhere(module: str, name: str, value: Any) -> list[tuple[object, str, Any]]:
    """Return the places of a module's constant: others that import it, too, if it is public."""
    own = importlib.import_module(module)
    places: list[tuple[object, str, Any]] = [(own, name, value)]
    if not name.startswith('_'):
        known = getattr(own, name)
        places += [
            (other, name, value)
            for key, other in sorted(sys.modules.items())
            if key.startswith(('power_lab.', 'power_estimator.'))
            and other is not own
            and getattr(other, name, None) is known
        ]
    return places


def kept_by(memory: Memory) -> list[tuple[object, str, Any]]:
    """Replacements of the parts of a diagnosis by such that keep their results."""
    fit, intervals = Fitter.fit, Fitter.intervals
    examine, residual = Examiner.examine, Examiner.residual
    singles, found_set = Diagnoser._singles, statistics.confidence_set
    structure, shapes, offered = (
        procedure.examine_structure,
        procedure.best_shapes,
        procedure.candidates,
    )
    shaped, sampled = candidate_screener.shaped, procedure.unseen
    screener = type('_Screener', (KeptScreener,), {'memory': memory})

    def kept_fit(
        self: Fitter,
        of: Structure,
        start: Fit | None = None,
        iterations: int = 3,
        delay: float | None = None,
        give_up: float = np.inf,
    ) -> Any:
        given = iterations, delay, give_up
        key = ('fit', *_blocks_key(self), structure_key(of), id(start), *given)
        return memory.get(key, lambda: fit(self, of, start, *given), (of, start))

    def kept_intervals(self: Fitter, of: Fit, seed: int = 0, level: float = 0.95) -> Any:
        key = ('intervals', id(of), seed, level)
        return memory.get(key, lambda: intervals(self, of, seed, level), of)

    def kept_examine(self: Examiner, of: Fit, names: Sequence[str] = ()) -> Any:
        key = ('examine', id(of), tuple(names), hash(self.folds.test.tobytes()))
        key += _blocks_key(self.fitter)
        return memory.get(key, lambda: examine(self, of, names), of)

    def kept_residual(self: Examiner, evidence: Evidence, *, all_rows: bool = False) -> Any:
        key = ('residual', id(evidence), all_rows)
        return memory.get(key, lambda: residual(self, evidence, all_rows=all_rows), evidence)

    def kept_singles(self: Diagnoser, none: Evidence, own: Any, found: Any) -> Any:
        key = ('singles', id(none), id(own), procedure._FINALISTS)
        return memory.get(key, lambda: singles(self, none, own, found), (none, own))

    def kept_structure(
        residual: Any, prepared: Any, blocks: Any, folds: Any, seed: int = 0
    ) -> Any:
        settings = residual_structure._ROWS, residual_structure._LAGS, residual_structure._TREES
        key = ('structure', *settings, id(residual), hash(blocks.valid.tobytes()), seed)
        return memory.get(
            key, lambda: structure(residual, prepared, blocks, folds, seed), residual
        )

    def kept_shapes(own: Any) -> Any:
        return memory.get(('shapes', id(own)), lambda: shapes(own), own)

    def kept_candidates(fitter: Fitter, base: Structure, catalogue: Any) -> Any:
        key = ('candidates', id(fitter.prepared), structure_key(base), id(catalogue))
        return memory.get(key, lambda: offered(fitter, base, catalogue), (base, catalogue))

    def kept_shaped(fitter: Fitter, folds: Any, base: Structure) -> Any:
        key = ('shaped', *_blocks_key(fitter), structure_key(base))
        return memory.get(key, lambda: shaped(fitter, folds, base), base)

    def kept_sampled(prepared: Any, of: Fit) -> Any:
        return memory.get(('sampled', id(of)), lambda: sampled(prepared, of), of)

    def kept_screener(fitter: Fitter, folds: Any, base: Fit, others: Sequence[Active]) -> Any:
        key = ('screener', *_blocks_key(fitter), id(base), tuple(map(active_key, others)))
        return memory.get(key, lambda: screener(fitter, folds, base, others), (base, others))

    def kept_set(losses: Sequence[Any], *, size: float | None = None, seed: int = 0) -> Any:
        size = statistics.SIZE if size is None else size
        settings = statistics._REPETITIONS, statistics._BLOCK, statistics._ALIKE, size, seed
        key = ('set', *settings, *(hash(loss.tobytes()) for loss in losses))
        return memory.get(key, lambda: found_set(losses, size=size, seed=seed))

    pairs: list[tuple[object, str, Any]] = [
        (Fitter, 'fit', kept_fit),
        (Fitter, 'intervals', kept_intervals),
        (Examiner, 'examine', kept_examine),
        (Examiner, 'residual', kept_residual),
        (Diagnoser, '_singles', kept_singles),
    ]
    for original, kept in (
        (structure, kept_structure),
        (shapes, kept_shapes),
        (offered, kept_candidates),
        (shaped, kept_shaped),
        (sampled, kept_sampled),
        (found_set, kept_set),
        (CandidateScreener, kept_screener),
    ):
        pairs += [
            (module, name, kept)
            for key, module in sorted(sys.modules.items())
            if key.startswith('power_lab.diagnose.')
            for name, value in vars(module).items()
            if value is original
        ]
    return pairs
