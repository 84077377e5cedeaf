"""Benchmark of models on recordings, on samples that none of them was fitted to."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from statistics import fmean, pstdev
from typing import Any, Final

import numpy as np
from power_recordings.alignment.dataset import AlignedDataset
from power_recordings.messages.samples import EstimateSamples
from power_recordings.reading.reader import Recording
from rich.text import Text
from wattwalk_core.arrays import Singles
from wattwalk_core.console import output, print_table
from wattwalk_core.errors import InputError

from power_estimator.drive_types import infer_types
from power_estimator.evaluation.traces import Traces, traces
from power_estimator.judge.judge import Judge
from power_estimator.judge.recordings import load
from power_estimator.judge.result import JudgedModel
from power_estimator.loader import load_model
from power_estimator.model import Needs, PowerModel
from power_estimator.network.ppn import PowerPredictionNetwork
from power_estimator.scores import Score

WIDTH = 140  # of tables where stdout is no terminal


def table(folds: Sequence[Sequence[JudgedModel]]) -> dict[str, Any]:
    """Return the scores of models, for each fold, averaged over folds in the form of the JSON.

    It is {`models`: [{`name`, `held_out`, `drives` {name: {`r2`, `r2_std`, `rmse_w`, …}}, `types`,
    `total`, `supply`}]}. `r2_std` is the spread between folds, of one fold that over stretches.
    """
    models = []
    for name in (judged.name for judged in folds[0]):
        of = [judged for fold in folds for judged in fold if judged.name == name]
        if len(of) < len(folds):
            continue
        models.append(
            {
                'name': name,
                'held_out': of[0].held_out,
                'drives': _each([judged.drives for judged in of]),
                'types': _each([judged.types for judged in of]),
                'total': _mean([judged.total for judged in of if judged.total]),
                'supply': _mean([judged.supply.score for judged in of if judged.supply]),
            }
        )
    return {'models': models}


def _each(folds: Sequence[Mapping[str, Score]]) -> dict[str, Any]:
    keys = dict.fromkeys(key for fold in folds for key in fold)
    return {key: _mean([fold[key] for fold in folds if key in fold]) for key in keys}


def _mean(scores: Sequence[Score]) -> dict[str, float | None] | None:
    scores = [score for score in scores if score.samples]
    if not scores:
        return None
    rows = [asdict(score) for score in scores]
    means = {key: fmean(float(row[key]) for row in rows) for key in rows[0] if key != 'samples'}
    mean = Score(samples=round(fmean(score.samples for score in scores)), **means)
    r2s = [score.r2 for score in scores]
    if len(r2s) > 1:
        mean = replace(mean, r2_std=pstdev(r2s) if np.isfinite(r2s).all() else float('nan'))
    return mean.json()


def print_scores(table: Mapping[str, Any], title: str) -> None:
    """Print a `table` of scores: R² ± spread per drive type and of the sum, the best in bold."""
    console, models = output(WIDTH), table['models']
    keys = list(dict.fromkeys(key for m in models for key in m['types']))
    columns = {f'{key} R²': [m['types'].get(key) for m in models] for key in keys}
    if any(m['total'] for m in models):
        columns['sum R²'] = [m['total'] for m in models]
    wide = console.width >= 110
    errors = {'RMSE [W]': ('rmse_w', 1), 'energy error [%]': ('energy_error', 100)} if wide else {}
    rows = [
        [
            model['name'],
            *(_r2(column, row) for column in columns.values()),
            *(_join([s for s in model['types'].values() if s], *each) for each in errors.values()),
        ]
        for row, model in enumerate(models)
    ]
    print_table(console, ('model', *columns, *errors), rows, title)


def _join(scores: Sequence[Mapping[str, float | None]], key: str, factor: float) -> str:
    values = [score[key] for score in scores]
    return ' '.join('–' if value is None else f'{factor * value:.1f}' for value in values)


def _r2(column: Sequence[Mapping[str, float] | None], row: int) -> Text:
    score = column[row]
    if score is None or score.get('r2') is None:
        return Text('–')
    spread = f' ±{score["r2_std"]:.3f}' if score.get('r2_std') else ''
    best = max(s['r2'] for s in column if s is not None and s.get('r2') is not None)
    return Text(f'{score["r2"]:.3f}{spread}', style='bold' if score['r2'] == best else '')


RECORDED: Final = 'recorded'
AS_RECORDED: Final = 'as it was recorded'
_STANDS_FOR: Final = 0.02  # s that end at an estimate's stamp
_LONGEST_GAP: Final = 0.05  # s between estimates that are joined by a line


class RecordedEstimate:
    """Power model that returns the topic `power_estimate` of recordings.

    An estimate is the mean of the 20 ms that end at its stamp. It is placed in their middle and
    interpolated linearly. Estimates whose status is not 0 count as unknown.
    """

    name = RECORDED
    needs = Needs({}, 1 / _STANDS_FOR, smooth=False)

    def __init__(self, bags: Sequence[Path]) -> None:
        """Read the estimates; InputError for a recording that has none."""
        self._estimates: list[EstimateSamples] = []
        for bag in bags:
            recording = Recording.open(bag)
            if not recording.has('power_estimate'):
                raise InputError(
                    f'{bag} has no power_estimate topic: leave the model {RECORDED!r} out, or '
                    f'record while `ros2 run power_estimator estimate` runs'
                )
            self._estimates.append(recording.power_estimate())

    def predict(self, data: AlignedDataset) -> Singles:
        """Return the estimates in W [T, D]; data must be of the same recordings in order."""
        power = np.full(data.power.shape, np.nan, np.float32)
        for number, estimates in enumerate(self._estimates):
            rows = np.flatnonzero(data.recording == number)
            good = estimates.status == 0
            times = estimates.stamp_ns[good] / 1e9 - _STANDS_FOR / 2
            if len(times) < 2:
                continue
            after = np.clip(np.searchsorted(times, data.time[rows]), 1, len(times) - 1)
            before = after - 1
            inside = (times[before] <= data.time[rows]) & (data.time[rows] <= times[after])
            inside &= times[after] - times[before] < _LONGEST_GAP
            for column, name in enumerate(data.names):
                if name in estimates.names:
                    known = estimates.power[good, estimates.names.index(name)]
                    line = np.interp(data.time[rows], times, known)
                    power[rows, column] = np.where(inside, line, np.nan)
        return power


@dataclass(frozen=True)
class Benchmark:
    """Scores of models on recordings, with traces for a figure."""

    table: dict[str, Any]
    traces: Traces
    extent: str  # of data judged on
    held_out: tuple[str, ...]  # ways in which samples were held out


def run(
    bags: Sequence[Path],
    specs: Sequence[str],
    drives: Sequence[str] = (),
    *,
    slow: bool = False,
    anyway: bool = False,
) -> Benchmark:
    """Score models, given as for `load_model`, on the samples that all of them may be judged on.

    specs may have `recorded`, the live estimate in the recordings. drives, slow, anyway: as in
    `judge.recordings.load`. InputError if there are no such samples.
    """
    if len(set(specs)) < len(specs):
        raise InputError(f'--models names a model twice: {", ".join(specs)}')
    models: list[PowerModel] = [
        RecordedEstimate(bags) if spec == RECORDED else load_model(spec) for spec in specs
    ]
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
        judge.prepared.extent_of(int(rows.sum())),
        tuple(dict.fromkeys(one.held_out for one in judged)),
    )
