"""Benchmark of models on recordings, on samples that none of them was fitted to."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from wattwalk_core.errors import InputError

from power_estimator.drive_types import infer_types
from power_estimator.effects.signals.reducer import REDUCED_RATE
from power_estimator.evaluation.recorded_estimate import AS_RECORDED, RECORDED, RecordedEstimate
from power_estimator.evaluation.tables import table
from power_estimator.evaluation.traces import Traces, traces
from power_estimator.judge.judge import Judge
from power_estimator.judge.recordings import load
from power_estimator.loader import load_model
from power_estimator.model import PowerModel
from power_estimator.network.ppn import PowerPredictionNetwork


@dataclass(frozen=True)
class Benchmark:
    """Result of a benchmark."""

    table: dict[str, Any]
    traces: Traces
    seconds: float  # of data judged on
    held_out: tuple[str, ...]  # ways in which samples were held out


def run(
    bags: Sequence[Path],
    specs: Sequence[str],
    drives: Sequence[str] = (),
    *,
    slow: bool = False,
    anyway: bool = False,
) -> Benchmark:
    """
    Score models on recordings by the judge, on the samples that all of them may be judged on.

    slow, anyway: as in `load`. InputError if there are no such samples.
    """
    if len(set(specs)) < len(specs):
        raise InputError(f'--models names a model twice: {", ".join(specs)}')
    models = [_open(spec, bags) for spec in specs]
    judge = Judge(load(bags, drives, slow=slow, anyway=anyway))
    networks = [model for model in models if isinstance(model, PowerPredictionNetwork)]
    types = networks[0].types if networks else infer_types(judge.prepared.names)
    judged = tuple(
        replace(one, how=(AS_RECORDED,) * len(one.how)) if one.name == RECORDED else one
        for one in judge.compare(models, specs, types, supply=not drives)
    )
    rows = np.any([one.rows.any(axis=1) for one in judged], axis=0)
    return Benchmark(
        table([judged]),
        traces(judge, judged),
        float(rows.sum()) / REDUCED_RATE,
        tuple(dict.fromkeys(one.held_out for one in judged)),
    )


def _open(spec: str, bags: Sequence[Path]) -> PowerModel:
    return RecordedEstimate(bags) if spec == RECORDED else load_model(spec)
