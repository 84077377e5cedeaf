"""Choice of what the missing power depends on, and of the smallest formula that says so."""

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from wattwalk_core.arrays import Floats

from power_lab.discover.formula import PRIMITIVES, Formula, Place, Primitive
from power_lab.structure.drivers import Family
from power_lab.structure.shapes import DriveProblem, LearnedShape

_LEAST_LEFT = 1e-4  # of a column's square, after the base's columns are projected out


@dataclass(frozen=True)
class Expression:
    """Primitive function fitted to the learned shape of one drive."""

    primitive: Primitive
    parameters: dict[str, float]
    gain: float  # W² by row, held out, its parameters chosen anew in each fold


def express(problem: DriveProblem, shape: LearnedShape) -> list[Expression]:
    """Fit every primitive function to a learned shape; those that gain nothing are left out."""
    reduced = [_partial(problem, shape, fold) for fold in range(problem.folds.count + 1)]
    out = []
    for primitive in PRIMITIVES.values():
        grid, columns = primitive.on(shape.nodes)
        if not grid:
            continue
        found = _best(problem, shape, reduced, columns)
        if found is not None:
            place, gain = found
            out.append(Expression(primitive, grid[place], gain))
    return out


@dataclass(frozen=True)
class _Partial:
    """Normal equations of the nodes with the base's columns projected out."""

    gram: Floats  # [K, K]
    moment: Floats  # [K]
    own: Floats  # [m], coefficients of the base alone
    slope: Floats  # [m, K], how they give way


def _partial(problem: DriveProblem, shape: LearnedShape, fold: int) -> _Partial:
    m = len(problem.ridge)
    gram, moment = shape.moments.gram[fold], shape.moments.moment[fold]
    solved = shape.by_fold[fold][:m]
    held = problem.held(solved)
    free = ~held
    own, slope = np.where(held, solved, 0.0), np.zeros((m, len(shape.nodes)))
    matrix = gram[:m, :m] + np.diag(problem.ridge)
    right = moment[:m] - gram[:m, :m][:, held] @ solved[held]
    inner = matrix[np.ix_(free, free)]
    scale = np.sqrt(np.maximum(np.diag(inner), 1e-300))
    inner = inner / np.outer(scale, scale) + 1e-9 * np.eye(len(scale))
    both = np.column_stack([right[free], -gram[:m, m:][free]]) / scale[:, None]
    found = np.linalg.solve(inner, both) / scale[:, None]
    own[free], slope[free] = found[:, 0], found[:, 1:]
    cross = gram[m:, :m]
    return _Partial(gram[m:, m:] + cross @ slope, moment[m:] - cross @ own, own, slope)


def _best(
    problem: DriveProblem, shape: LearnedShape, reduced: list[_Partial], columns: Floats
) -> tuple[int, float] | None:
    """Best of columns [n, K, k] on everything, and the held-out gain of the best of each fold."""
    chosen = [_solve(part, columns) for part in reduced]
    place, _, improvement = chosen[-1]
    if improvement <= 0.0:
        return None
    full = []
    for part, (index, own, _) in zip(reduced[:-1], chosen[:-1], strict=True):
        nodes = columns[index] @ own
        full.append(np.concatenate([part.own + part.slope @ nodes, nodes]))
    error = float(shape.moments.error(np.stack(full)).sum())
    return place, problem.base_error - error / shape.moments.rows


def _solve(part: _Partial, columns: Floats) -> tuple[int, Floats, float]:
    """Index, coefficients and fall of the training error of the best of columns [n, K, k]."""
    turned = columns.transpose(0, 2, 1)  # [n, k, K]
    gram = (turned @ part.gram) @ columns
    moment = turned @ part.moment
    k = gram.shape[1]
    diagonal = np.diagonal(gram, axis1=1, axis2=2)
    scale = np.sqrt(np.maximum(diagonal, 1e-12))
    whole = np.square(turned) @ np.diag(part.gram)
    dead = (diagonal < _LEAST_LEFT * np.abs(whole)).any(axis=1)
    if k == 1:
        solved = moment / np.square(scale)
    else:
        unit = gram / (scale[:, :, None] * scale[:, None, :]) + 1e-6 * np.eye(k)
        solved = np.linalg.solve(unit, (moment / scale)[..., None])[..., 0] / scale
    fall = np.where(dead, -np.inf, (solved * moment).sum(axis=1))
    index = int(np.argmax(fall))
    return index, solved[index], float(fall[index])


KEEPS = 0.9  # share of the shape's gain that a formula must keep to be called one
CLOSE = 0.85  # share of the best score from which on an option comes into question
_NEAR_BEST, _LEAST_OF_BEST = 0.995, 0.95
"""
Share of the best formula's gain that a smaller one must keep, or all but what is too small to be
judged, if that is not more than a twentieth.
"""
_HANDICAP = {'other_drive': 0.85}
"""Factor on the gain of another drive, which must explain more than the own state."""
_MEMORY_HANDICAP = 0.93
_WAVE_HANDICAP = 0.97
_ASYMMETRIC, _ASYMMETRY_HANDICAP = ('speed', 'torque', 'acceleration'), 0.995

Explained = Mapping[int, Sequence[tuple[LearnedShape, Sequence[Expression]]]]
"""By drive: shapes with their formulas."""


@dataclass(frozen=True)
class Option:
    """Best formula of one family over all drives, with its score."""

    formula: Formula
    shape_gain: float
    score: float
    shapes: Mapping[int, LearnedShape]

    @property
    def kept(self) -> float:
        """Share of the shape's gain that the formula keeps."""
        return self.formula.gain / max(self.shape_gain, 1e-12)


def options(
    explained: Explained, least: Mapping[int, float], floor: Mapping[int, float]
) -> list[Option]:
    """Best formula of each family that explains enough, the highest score first.

    explained: shapes and their formulas by drive; least: W² by drive that counts as explained at
    all; floor: W² by drive that can be judged.
    """
    groups: dict[tuple[str, ...], dict[int, list[tuple[LearnedShape, Sequence[Expression]]]]]
    groups = defaultdict(lambda: defaultdict(list))
    for drive, rows in explained.items():
        for shape, expressions in rows:
            groups[shape.family.group][drive].append((shape, expressions))
    found = [_option(by_drive, least, floor) for by_drive in groups.values()]
    return sorted((one for one in found if one is not None), key=lambda one: -one.score)


def without_known(
    ranked: Sequence[Option], term_of: Callable[[Formula], str]
) -> tuple[list[Option], str]:
    """Options that repeat no term of the model, and the first term that one repeats ('' for none).

    None are left where those that repeat a term explain clearly more.
    """
    terms = [term_of(one.formula) for one in ranked]
    new = [one for one, term in zip(ranked, terms, strict=True) if not term]
    repeated = next((term for term in terms if term), '')
    if new and new[0].score < CLOSE * ranked[0].score:
        return [], repeated
    return new, repeated


def _option(
    by_drive: Mapping[int, Sequence[tuple[LearnedShape, Sequence[Expression]]]],
    least: Mapping[int, float],
    floor: Mapping[int, float],
) -> Option | None:
    shapes = {d: max((s for s, _ in rows), key=lambda s: s.gain) for d, rows in by_drive.items()}
    candidates: dict[str, dict[int, Place]] = defaultdict(dict)
    for drive, rows in by_drive.items():
        for shape, expressions in rows:
            for one in expressions:
                known = candidates[one.primitive.name].get(drive)
                if one.gain >= least[drive] and (known is None or one.gain > known.gain):
                    place = Place(shape.family, one.parameters, one.gain)
                    candidates[one.primitive.name][drive] = place
    formulas = [Formula(PRIMITIVES[name], places) for name, places in candidates.items() if places]
    if not formulas:
        return None
    best = max(formula.gain * _weight(formula) for formula in formulas)
    judged = sum(floor[drive] for drive in shapes)
    enough = min(_NEAR_BEST * best, max(best - judged, _LEAST_OF_BEST * best))
    near = [f for f in formulas if f.gain * _weight(f) >= enough]
    chosen = min(near, key=lambda f: (f.primitive.complexity, -f.gain))
    shape_gain = sum(max(shapes[d].gain, place.gain) for d, place in chosen.places.items())
    score = handicap(chosen.family) * max(chosen.gain, 0.8 * shape_gain)
    return Option(chosen, shape_gain, score, {d: shapes[d] for d in chosen.places})


def handicap(family: Family) -> float:
    """Factor on a family's gain, at most 1, lower for rarer causes (memory, other drives)."""
    own = _MEMORY_HANDICAP if family.driver.memory else 1.0
    if family.driver.name in _ASYMMETRIC:
        own *= _ASYMMETRY_HANDICAP
    return own * _HANDICAP.get(family.kind, 1.0)


def _weight(formula: Formula) -> float:
    return _WAVE_HANDICAP if formula.primitive.terms > 1 else 1.0
