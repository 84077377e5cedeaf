"""Benchmark of models on recordings, on samples that none of them was trained on."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from power_recordings.alignment.dataset import AlignedDataset
from power_recordings.reading.reader import open_recordings
from wattwalk_core.errors import InputError

from power_estimator import recordings
from power_estimator.drive_types import DriveType, assign, infer_types
from power_estimator.evaluation.baseline_model import BASELINE, BaselineModel
from power_estimator.evaluation.comparison import (
    Evaluation,
    PowerComparison,
    compare,
    evaluate,
    rows_of,
    table,
)
from power_estimator.evaluation.coverage import with_coverage
from power_estimator.evaluation.recorded_estimate import RECORDED, RecordedEstimate
from power_estimator.evaluation.traces import Traces, traces
from power_estimator.evaluation.whole_robot import whole_robot
from power_estimator.loader import load_model
from power_estimator.model import PowerModel
from power_estimator.network.checkpoint import TrainingRecording
from power_estimator.network.ppn import PowerPredictionNetwork
from power_estimator.proxies import Proxy
from power_estimator.training.protocol import Part

SPREAD = 6  # stretches whose R² gives the spread, as many as the protocol has segments
SHORTEST = 10.0  # s of a stretch; R² of a shorter one means little


@dataclass(frozen=True)
class Benchmark:
    """Result of a benchmark."""

    table: dict[str, Any]
    traces: Traces
    seconds: float  # of data evaluated on
    held_out: bool  # a network was trained on other parts of a recording


class NamedModel:
    """A model under the name that the user gave it."""

    def __init__(self, name: str, model: PowerModel) -> None:
        self.name = name
        self.needs = model.needs
        self._model = model

    def predict(self, data: AlignedDataset) -> NDArray[np.float32]:
        """Return the model's prediction."""
        return self._model.predict(data)


def run(bags: Sequence[Path], specs: Sequence[str], drives: Sequence[str] = ()) -> Benchmark:
    """
    Score models on recordings; InputError if no samples are left to evaluate on.

    A network is evaluated only on the test part of a recording that it was trained on, and all
    other models on the same samples. Proxies and the baseline model are fitted to the samples that
    are left out or, on recordings that no network was trained on, to the evaluated samples, which
    favours them.
    """
    if len(set(specs)) < len(specs):
        raise InputError(f'--models names a model twice: {", ".join(specs)}')
    models = [_open(spec, bags) for spec in specs]
    networks = [m for m in models if isinstance(m, PowerPredictionNetwork)]
    data = recordings.load(open_recordings(bags), drives)
    measured = data.measured_drives()
    if not measured:
        raise InputError(f'{", ".join(map(str, bags))}: no drive has measured power')
    types = networks[0].types if networks else infer_types(data.names)
    evaluated = _evaluated(data, bags, networks, types)
    if not evaluated.any():
        raise InputError(
            f'{", ".join(map(str, bags))}: nothing is left that no network was trained on; '
            f'give another recording'
        )
    labels = np.where(evaluated, Part.TEST, Part.TRAIN).astype(np.int8)
    test = rows_of(data, labels, Part.TEST, 8)
    rest = rows_of(data, labels, Part.TRAIN, 8)
    scaled_on = rest if len(rest.time) > len(test.time) / 10 else test
    ready: list[PowerModel] = [
        NamedModel(
            spec,
            model.fit(scaled_on, types) if isinstance(model, Proxy | BaselineModel) else model,
        )
        for spec, model in zip(specs, models, strict=True)
    ]
    comparison = compare(ready, test.drives(measured))
    scores = evaluate(comparison, types)
    for spec, model in zip(specs, models, strict=True):
        if isinstance(model, PowerPredictionNetwork):
            scores[spec] = with_coverage(scores[spec], comparison, spec, model, types)
    _require(scores, specs, bags)
    robot = whole_robot(ready, test, scaled_on)
    if robot is not None:
        supply = robot.scores()
        scores = {m: replace(e, supply=supply.get(m)) for m, e in scores.items()}
    result = table([scores])
    if len(test.time) / test.rate >= SPREAD * SHORTEST:
        _add_spread(result, comparison, types)
    r2 = {drive: s.r2 for drive, s in scores[specs[0]].drives.items()}
    seconds = len(test.time) / test.rate
    return Benchmark(
        result, traces(comparison, r2, robot, specs[0]), seconds, not bool(evaluated.all())
    )


def _open(spec: str, bags: Sequence[Path]) -> PowerModel:
    if spec == RECORDED:
        return RecordedEstimate(bags)
    return BaselineModel() if spec == BASELINE else load_model(spec)


def _evaluated(
    data: AlignedDataset,
    bags: Sequence[Path],
    networks: Sequence[PowerPredictionNetwork],
    types: Sequence[DriveType],
) -> NDArray[np.bool_]:
    evaluated = np.ones(len(data.time), bool)
    if not networks:
        return evaluated
    known: list[TrainingRecording] = [recordings.describe(bag) for bag in bags]
    present = [name for name, columns in assign(data.names, types).items() if columns]
    for network in networks:
        for name in present:
            evaluated &= recordings.held_out(data, known, network.checkpoint.recordings, name)
    return evaluated


def _require(scores: dict[str, Evaluation], specs: Sequence[str], bags: Sequence[Path]) -> None:
    for spec in specs:
        if not any(s.samples for s in scores[spec].drives.values()):
            raise InputError(
                f'{spec} says nothing about the drives of {", ".join(map(str, bags))}'
            )


def _add_spread(
    result: dict[str, Any], comparison: PowerComparison, types: Sequence[DriveType]
) -> None:
    pieces = np.array_split(np.arange(len(comparison.time)), SPREAD)
    parts = [
        evaluate(
            replace(
                comparison,
                time=comparison.time[rows],
                segment=comparison.segment[rows],
                measured=comparison.measured[rows],
                estimated={m: p[rows] for m, p in comparison.estimated.items()},
            ),
            types,
        )
        for rows in pieces
        if len(rows) > 1
    ]
    for model, spread in zip(result['models'], table(parts)['models'], strict=True):
        for group in ('drives', 'types'):
            for key, scores in model[group].items():
                other = spread[group].get(key)
                if scores is not None:
                    scores['r2_std'] = other['r2_std'] if other else None
        if model['total'] and spread['total']:
            model['total']['r2_std'] = spread['total']['r2_std']
