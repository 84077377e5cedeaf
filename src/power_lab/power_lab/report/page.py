"""The two pages of the lab: a diagnosis, and a comparison."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from power_estimator.effects import Catalogue
from power_estimator.effects.signals.prepared import WHOLE, Prepared
from power_estimator.judge.result import JudgedModel, over_meters
from power_estimator.posterior.sensors import SENSORS
from wattwalk_core.arrays import Floats
from wattwalk_core.pages.page import Page, escape

from power_lab.compare.comparison import Comparison, by_drive, compare
from power_lab.compare.regimes import Regime
from power_lab.diagnose.findings import UNLIKELY, certainty
from power_lab.diagnose.outcome import Outcome
from power_lab.report import figures
from power_lab.report.figures import Stairs, noise_w
from power_lab.structure.words import in_words, verdict_in_words

_HIGHEST = 2.5  # times the highest error, of lines that are drawn

_COLOR_NAMES = ('orange', 'blue', 'green')


def write_diagnosis(
    path: Path, outcome: Outcome, also: Sequence[str], catalogue: Catalogue
) -> None:
    """Write the HTML page of a diagnosis; also: models whose errors are drawn beside it."""
    diagnosis = outcome.diagnosis
    prepared = outcome.prepared
    kind = verdict_in_words(diagnosis.verdict, len(diagnosis.effects))
    page = Page(f'{kind}: {outcome.model.name}')
    page.add(f'<p class="kind {diagnosis.verdict}">{kind}</p>')
    page.add(f'<h1 id="verdict">{escape(outcome.sentence)}</h1>')
    for note in outcome.notes:
        page.text(note)
    model, judged = outcome.model, outcome.judged
    facts = {
        'Model': f'{model.name} on {model.base}' if model.base else model.name,
        'Active effects': ', '.join(map(in_words, model.effects)) or 'none',
        'Recordings': ', '.join(entry['name'] for entry in outcome.loaded.identities),
        'Drives': ', '.join(prepared.names),
        'Length': f'{prepared.seconds:.0f} of {outcome.seconds:.0f} s without gaps',
    }
    page.facts(facts)
    shown = [judged.before] if judged.after is judged.before else [judged.before, judged.after]
    _section_traces(page, judged.comparison.prepared, shown)
    _section_failures(page, judged.comparison, shown, judged.comparison.regimes[0])
    _section_candidates(page, outcome)
    _section_next(page, outcome)
    others = compare(outcome.loaded, list(also), catalogue).json()['models'] if also else []
    _section_staircase(page, outcome, others)
    _section_measurement(page, outcome)
    _section_reading(page)
    page.write(path)


def write_comparison(path: Path, comparison: Comparison) -> None:
    """Write the HTML page of a comparison."""
    content = comparison.json()
    models = sorted(content['models'], key=_error)
    page = Page('Comparison of power models')
    page.add('<p class="kind no_evidence">Comparison</p>')
    page.add(f'<h1 id="verdict">{escape(closest(models))}</h1>')
    prepared = comparison.prepared
    facts = {
        'Recordings': ', '.join(prepared.recordings),
        'Drives': ', '.join(prepared.names),
        'Length': prepared.extent + ('' if prepared.steady else ' without gaps'),
    }
    page.facts(facts)
    rows = []
    for model in models:
        heads = model['name'], model['held_out']
        for drive, scores in [*model['drives'].items(), ('all drives', model['total'])]:
            cells = (_cell(scores[key]) for key in ('r2', 'rmse_w', 'bias_w', 'error_j'))
            rows.append([heads[0], drive, *cells, heads[1]])
            heads = '', ''
    page.heading('Errors')
    columns = ['model', 'drive', 'R²', 'RMSE W', 'bias W', 'energy J', 'kept apart by']
    page.table(columns, rows, numbers=(2, 3, 4, 5))
    names = [one.name for one in comparison.models]
    places = [names.index(model['name']) for model in models[: len(figures.LINES)]]
    best_last = [comparison.models[place] for place in reversed(places)]
    _section_traces(page, prepared, best_last)
    _section_failures(page, comparison, best_last, comparison.regimes[places[0]])
    steps = tuple(model['name'] for model in reversed(models))
    errors = tuple(map(_error, reversed(models)))
    figure = Stairs(steps, errors, noise_w(prepared.noise)).figure()
    page.heading('Side by side')
    page.add(page.figure(figure, 'Held-out error of each model'))
    page.write(path)


def _section_traces(page: Page, prepared: Prepared, shown: Sequence[JudgedModel]) -> None:
    """Measured power and the estimates of some models, the last one's delay taken out."""
    page.heading('Measured against model')
    part = (
        'Operating points, the least power first'
        if prepared.steady
        else 'At most twelve seconds without a gap in which the model is worst'
    )
    band = "The grey band of the error is the meter's noise."
    page.text(f'{part}. Drag to zoom, double-click to go back. {band}', faint=True)
    panels = {}
    for column in _worst_first(shown[0].residual):
        name, power = prepared.names[column], shown[-1].measured[:, column]
        own = {one.name: one.residual[:, column] for one in shown}
        if prepared.steady:
            order = np.argsort(power)
            own = {key: values[order] for key, values in own.items()}
            counted, axis = np.arange(len(order), dtype=np.float64), 'operating points by power'
            figure = figures.traces(counted, power[order], own, 0.0, axis=axis)
        else:
            gap_free = prepared.reducer.stretches()
            noise = float(prepared.noise[column])
            figure = figures.traces(prepared.time, power, own, noise, gap_free)
        panels[name] = page.figure(figure, f'Power of {name} over time', size='tall')
    page.tabs(panels)


def _items(page: Page, texts: Iterable[str]) -> None:
    items = ''.join(f'<li>{escape(text)}</li>' for text in texts)
    page.add(f'<ul class="regimes">{items}</ul>')


def _section_failures(
    page: Page, found: Comparison, shown: Sequence[JudgedModel], regimes: Sequence[Regime]
) -> None:
    """Errors of some models over state and groups; the map is of the first one."""
    page.heading('Where it fails')
    if regimes:
        _items(page, (regime.text for regime in regimes))
    named = zip(_COLOR_NAMES, shown, strict=False)
    legend = ', '.join(f'{color}: {one.name}' for color, one in named)
    text = 'Mean error (model − measured) over the state of each drive; the map is of '
    page.text(f'{text}{shown[0].name}. Lines and bars: {legend}.', faint=True)
    panels = {}
    prepared = found.prepared
    residuals = {one.name: by_drive(one.residual, prepared) for one in shown}
    measured = by_drive(shown[-1].measured, prepared)
    for column in _worst_first(residuals[shown[0].name]):
        name = prepared.signals.names[column]
        own = {key: values[:, column] for key, values in residuals.items()}
        state = {key: values[:, column] for key, values in found.state.items()}
        first = own[shown[0].name]
        limit = max(0.2, float(np.nanquantile(np.abs(first), 0.97)))
        figure = figures.torque_speed_map(state['torque'], state['velocity'], first, limit)
        places = [page.figure(figure, f'Error of {name} over torque and speed')]
        for key in ('acceleration', 'position', 'time', 'temperature'):
            if key not in state or not np.isfinite(state[key]).all():
                continue
            over = figures.error_over(key, state[key], own)
            if over is not None:
                places.append(page.figure(over, f'Error of {name} over {key}', size='low'))
        power = measured[:, column]
        groups = {'drawing': power >= 0, 'giving back': power < 0}
        for words in found.labels.values():
            kinds = [kind for kind in np.unique(words[:, column]) if kind]
            if len(kinds) > 1:
                groups.update({str(kind): words[:, column] == kind for kind in kinds})
        figure = figures.error_by(groups, own)
        places.append(page.figure(figure, f'Error of {name} by group', size='low'))
        panels[name] = f'<div class="pair">{"".join(places)}</div>'
    page.tabs(panels)


def _section_candidates(page: Page, outcome: Outcome) -> None:
    page.heading('Which effect explains it')
    diagnosis = outcome.diagnosis
    found = diagnosis.candidates
    page.text(
        'Watts that each effect explains and no effect of the model can, with the probability '
        'that it is missing. Coloured bars are plausible; grey ones are improbable. Share: of '
        'what the model misses, where the effect is added alone.'
    )
    shown = found[:10]
    names = [in_words(one.name) for one in shown]
    watts = [one.explains[1] for one in shown]
    plausible = [one.probability >= UNLIKELY for one in shown]
    page.add(page.figure(figures.candidates(names, watts, plausible), 'Candidates'))
    columns = [
        *('effect', 'probability', 'explains', '95 % interval', 'share', 'error falls by'),
        'coefficient (95 %)',
    ]
    rows = [
        [
            in_words(one.name),
            certainty(one.probability),
            f'{one.explains[1]:.2f} W',
            f'{one.explains[0]:.2f} … {one.explains[2]:.2f} W',
            f'{one.share:.0%}',
            f'{one.delta_rmse_w:.3f} W',
            f'{one.drive}: {one.in_words}',
        ]
        for one in found
    ]
    bold = [i for i, one in enumerate(found) if one.name in diagnosis.effects]
    page.table(columns, rows, numbers=(1, 2, 4, 5), bold=bold)
    regimes = outcome.judged.comparison.regimes[-1]
    if regimes and diagnosis.residual is not None:
        page.text(f'What is left is most at {regimes[0].text}.')


def _section_next(page: Page, outcome: Outcome) -> None:
    page.heading('Ties, and what to record next')
    ties = sorted({row.family for row in outcome.diagnosis.candidates if '/' in row.family})
    if ties:
        page.text('No recording like this one can tell these apart:')
        _items(page, (' = '.join(map(in_words, tie.split('/'))) for tie in ties))
    else:
        page.text('No two effects explain exactly the same in this recording.')
    motion = outcome.motion
    page.text(f'Next, record {motion.seconds:.0f} s {motion.reason}.')
    text = yaml.safe_dump(motion.content(), sort_keys=False, allow_unicode=True, width=90)
    summary = '<summary>the motion as a file (diagnose … --motion next.yaml)</summary>'
    page.add(f'<details>{summary}<pre>{escape(text)}</pre></details>')


def _section_staircase(page: Page, outcome: Outcome, others: Sequence[Mapping[str, Any]]) -> None:
    page.heading('The error falls')
    judged = outcome.judged
    noise = outcome.prepared.noise
    stairs = Stairs.of(outcome.model.history, judged.steps, outcome.loaded, noise)
    highest = _HIGHEST * max(stairs.errors)
    errors = {model['name']: _error(model) for model in others}
    high = [f'{name} {error:.1f} W' for name, error in errors.items() if error > highest]
    lines = {name: error for name, error in errors.items() if error <= highest}
    page.add(page.figure(stairs.figure(lines), 'Error from base to better', size='mid'))
    if high:
        page.text(f'Above the picture: {", ".join(high)}.')
    if judged.before is not judged.model:
        how = 'as it is, on recordings that it was not fitted on'
        page.text(f'{judged.model.name} {how}: {judged.model.rms_w:.2f} W.')
    if outcome.verdict == 'named':
        added = ' '.join(outcome.diagnosis.effects)
        page.text(
            f'To keep it: ros2 run power_lab add {added} --to {outcome.model.name}.yaml '
            '--bag … -o better.yaml',
            faint=True,
        )


def _section_measurement(page: Page, outcome: Outcome) -> None:
    page.heading('Is the measurement sound?')
    page.text(
        'Errors of the meter and the sensors are part of every fit, so that they are not taken '
        'for physics. One is significant if it is certain, and the error grows by ignoring it.'
    )
    columns = ['error', 'value', '95 % interval', 'error if ignored', 'of drive', 'significant']
    rows = [
        [
            name.replace('_', ' '),
            f'{term.value:.3g} {SENSORS[name].unit if SENSORS[name].unit != "1" else ""}',
            f'{term.interval[0]:.3g} … {term.interval[1]:.3g}',
            f'{term.watts:.2f} W',
            term.drive,
            'yes' if term.matters else 'no',
        ]
        for name, term in outcome.measurement.items()
    ]
    bold = [i for i, term in enumerate(outcome.measurement.values()) if term.matters]
    page.table(columns, rows, numbers=(3,), bold=bold)


def _section_reading(page: Page) -> None:
    page.add(
        '<h2>How to read this</h2><p class="faint">Products of the signals and the measured power '
        'pass the same low-pass at 12.5 Hz. Every error is on data that the coefficients were not '
        'fitted to (five folds of ten-second pieces with a second between). Probabilities come '
        'from a linear Gaussian model with errors of the sensors and a smooth discrepancy beside '
        'the effects. An effect is named at 0.95 or more, beside what stays unexplained.'
        '</p>'
    )


def _worst_first(residual: Floats) -> list[int]:
    """Columns of a residual [N, D], the one with the largest error first."""
    size = np.nanmean(np.square(residual), axis=0)
    return [int(column) for column in np.argsort(-np.nan_to_num(size))]


def closest(models: Sequence[Mapping[str, Any]]) -> str:
    """Name the model with the least error in a sentence; models: those of `Comparison.json`."""
    order = sorted(models, key=_error)
    best, worst = order[0], order[-1]
    robot = [*best['drives']] == [WHOLE]
    each, over = ('', '') if robot else (' for each drive', ' over the drives')
    text = f'{best["name"]} is {_error(best):.2f} W off{each}'
    if worst is not best:
        text = f'{best["name"]} is closest to the measurement: {_error(best):.2f} W{each}'
        text += f'; {worst["name"]} is {_error(worst):.2f} W off'
    return f'{text} (root mean square{over}, held-out data).'


def _error(model: Mapping[str, Any]) -> float:
    return over_meters(scores['rmse_w'] for scores in model['drives'].values())


def _cell(value: float | None) -> str:
    return '–' if value is None else f'{value:.3f}' if abs(value) < 100 else f'{value:.0f}'
