"""Search for the formula of a shape, on the shape's own normal equations."""

from dataclasses import dataclass

import numpy as np
from wattwalk_core.arrays import Floats

from power_lab.discover.grammar import PRIMITIVES, Primitive
from power_lab.structure.problem import DriveProblem
from power_lab.structure.shapes import LearnedShape

_LEAST_LEFT = 1e-4  # of a column's square, after the base's columns are projected out


@dataclass(frozen=True)
class Expression:
    """One primitive over a shape's driver on one drive."""

    primitive: Primitive
    parameters: dict[str, float]
    coefficients: Floats  # [terms]
    gain: float  # W² by row, held out, its parameters chosen anew in each fold


def express(problem: DriveProblem, shape: LearnedShape) -> list[Expression]:
    """Fit every primitive of the grammar to a shape."""
    reduced = [_partial(problem, shape, fold) for fold in range(problem.folds.count + 1)]
    out = []
    for primitive in PRIMITIVES.values():
        grid, columns = primitive.on(shape.nodes)
        if not grid:
            continue
        found = _best(problem, shape, reduced, columns)
        if found is None:
            continue
        place, coefficients, gain = found
        out.append(Expression(primitive, grid[place], coefficients, gain))
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
) -> tuple[int, Floats, float] | None:
    """Best of columns [n, K, k] on everything, and the held-out gain of the best of each fold."""
    chosen = [_solve(part, columns) for part in reduced]
    place, coefficients, improvement = chosen[-1]
    if improvement <= 0.0:
        return None
    full = []
    for fold in range(problem.folds.count):
        index, own, _ = chosen[fold]
        nodes = columns[index] @ own
        base = reduced[fold].own + reduced[fold].slope @ nodes
        full.append(np.concatenate([base, nodes]))
    error = float(shape.moments.error(np.stack(full)).sum())
    return place, coefficients, problem.base_error - error / shape.moments.rows


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
