"""Comparison of models on the same samples, and its table."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from statistics import fmean, pstdev
from typing import Any

import numpy as np
from numpy.typing import NDArray
from power_recordings.alignment.dataset import AlignedDataset

from power_estimator.drive_types import DriveType, assign
from power_estimator.evaluation.scores import Score, block_means, score
from power_estimator.model import PowerModel
from power_estimator.training.protocol import Part, runs

Floats = NDArray[np.float32]
RATE = 50.0  # Hz at which estimates are compared (Section II-A)


@dataclass(frozen=True)
class PowerComparison:
    """Measured and estimated power on one grid of 50 Hz; NaN where any model has no estimate."""

    names: tuple[str, ...]  # D drives
    time: NDArray[np.float64]  # s [N], middle of each block
    segment: NDArray[np.intp]  # [N], number of the gap-free stretch
    measured: Floats  # W [N, D]
    estimated: Mapping[str, Floats]  # W [N, D], by model


@dataclass(frozen=True)
class Evaluation:
    """Scores of one model."""

    drives: Mapping[str, Score] = field(default_factory=dict)
    types: Mapping[str, Score] = field(default_factory=dict)  # samples of all drives of a type
    total: Score | None = None  # sum over the drives, where all were measured
    supply: Score | None = None  # sum over the drives and electronics against the supply


def rows_of(
    data: AlignedDataset, labels: NDArray[np.int8], part: Part, shortest: int = 1
) -> AlignedDataset:
    """Return the samples of one part; each stretch becomes a segment of its own."""
    stretches = list(runs(labels, data.segment, part, shortest))
    index = np.concatenate([np.arange(s.start, s.stop) for s in stretches] or [np.arange(0)])
    chosen = data.rows(index)
    lengths = [s.stop - s.start for s in stretches]
    chosen.segment[:] = np.repeat(np.arange(len(stretches)), lengths)
    return chosen


def compare(models: Sequence[PowerModel], data: AlignedDataset) -> PowerComparison:
    """Run all models on the data and bring them and the measurement to 50 Hz."""
    block = max(1, round(data.rate / RATE))
    stretches = list(data.segments())

    def mean(values: Floats) -> Floats:
        return block_means(values, stretches, block)

    estimated = {model.name: mean(model.predict(data)) for model in models}
    measured = mean(data.power)
    known = np.isfinite(measured)
    for values in estimated.values():
        known &= np.isfinite(values)
    hidden = ~known
    for values in (measured, *estimated.values()):
        values[hidden] = np.nan
    time = [data.time[s][: (s.stop - s.start) // block * block] for s in stretches]
    middles = np.concatenate([t.reshape(-1, block).mean(axis=1) for t in time] or [np.empty(0)])
    counts = [(s.stop - s.start) // block for s in stretches]
    segment = np.repeat(np.arange(len(stretches)), counts)
    return PowerComparison(data.names, middles, segment, measured, estimated)


def evaluate(comparison: PowerComparison, types: Sequence[DriveType]) -> dict[str, Evaluation]:
    """Score each model per drive, per drive type and for the sum of the drives."""
    measured, names = comparison.measured, comparison.names
    there = [c for c in range(len(names)) if np.isfinite(measured[:, c]).any()]
    columns = {t: [c for c in cs if c in there] for t, cs in assign(names, types).items()}
    total = measured[:, there].sum(axis=1)
    return {
        model: Evaluation(
            {names[c]: score(measured[:, c], values[:, c], RATE) for c in there},
            {t: score(measured[:, c], values[:, c], RATE) for t, c in columns.items() if c},
            score(total, values[:, there].sum(axis=1), RATE),
        )
        for model, values in comparison.estimated.items()
    }


def merge(parts: Sequence[Mapping[str, Evaluation]]) -> dict[str, Evaluation]:
    """Merge evaluations of disjoint drives; there is no total."""
    return {
        model: Evaluation(
            {k: v for part in parts for k, v in part[model].drives.items()},
            {k: v for part in parts for k, v in part[model].types.items()},
        )
        for model in parts[0]
        if all(model in part for part in parts)
    }


def table(folds: Sequence[Mapping[str, Evaluation]]) -> dict[str, Any]:
    """
    Average over folds in the form of the benchmark's JSON; `r2_std` is the spread between them.

    {`models`: [{`name`, `drives` {name: {`r2`, `r2_std`, `rmse_w`, …}}, `types`, `total`,
    `supply`}]}.
    """
    models = []
    for name in [name for name in folds[0] if all(name in fold for fold in folds)]:
        of = [fold[name] for fold in folds]
        models.append(
            {
                'name': name,
                'drives': _each(of, lambda e: e.drives),
                'types': _each(of, lambda e: e.types),
                'total': _mean([e.total for e in of if e.total]),
                'supply': _mean([e.supply for e in of if e.supply]),
            }
        )
    return {'models': models}


def _each(
    folds: Sequence[Evaluation], select: Callable[[Evaluation], Mapping[str, Score]]
) -> dict[str, Any]:
    keys = dict.fromkeys(key for fold in folds for key in select(fold))
    return {key: _mean([select(f)[key] for f in folds if key in select(f)]) for key in keys}


def _mean(scores: Sequence[Score]) -> dict[str, float | None] | None:
    scores = [s for s in scores if s.samples]
    if not scores:
        return None
    rows = [asdict(s) for s in scores]
    values = {key: fmean(float(row[key]) for row in rows) for key in rows[0]}
    r2s = [s.r2 for s in scores]
    several = len(r2s) > 1 and np.isfinite(r2s).all()
    values['r2_std'] = pstdev(r2s) if several else float('nan')
    return {key: value if np.isfinite(value) else None for key, value in values.items()}
