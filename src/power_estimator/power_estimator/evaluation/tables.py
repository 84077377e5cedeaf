"""Tables on the terminal."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from statistics import fmean, pstdev
from typing import Any

import numpy as np
from rich.text import Text
from wattwalk_core.console import output, print_table

from power_estimator.judge.result import JudgedModel
from power_estimator.scores import Score

WIDTH = 140  # of tables where stdout is no terminal


def table(folds: Sequence[Sequence[JudgedModel]]) -> dict[str, Any]:
    """Average over folds in the form of the benchmark's JSON.

    {`models`: [{`name`, `held_out`, `drives` {name: {`r2`, `r2_std`, `rmse_w`, …}}, `types`,
    `total`, `supply`}]}. `r2_std` is the spread between folds, of one fold that over stretches.
    """
    common = [name for name in (m.name for m in folds[0]) if all(_named(f, name) for f in folds)]
    models = []
    for name in common:
        of = [judged for fold in folds for judged in _named(fold, name)]
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


def _named(fold: Sequence[JudgedModel], name: str) -> list[JudgedModel]:
    return [judged for judged in fold if judged.name == name]


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
    """Print R² ± spread per drive type and of the sum; best in bold."""
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
