"""Results as tables on a terminal."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from power_estimator.effects import builtin_catalogue
from power_estimator.effects.model_file.model import EffectModel, FittedValue
from power_estimator.effects.signals.reducer import REDUCED_RATE
from power_recordings.alignment.dataset import AlignedDataset
from power_recordings.quality.physics import ShaftBalance, power_balance
from rich.console import Console
from rich.markup import escape
from rich.table import Table
from wattwalk_core.errors import printable

from power_lab.budget.tables import ruled_table
from power_lab.diagnose.findings import certainty
from power_lab.diagnose.outcome import Outcome
from power_lab.diagnose.verdict import candidates_to_show
from power_lab.discover.outcome import DiscoveryOutcome
from power_lab.structure.owners_terms import fitted_in_owners_terms

_AT_END = (
    '~ at the end of its interval: the fit and the posterior, which allows for errors of the '
    'sensors, disagree'
)
_ABREAST = 4  # drives whose values fit beside each other
_AT_BOUND = '* at the bound that the catalogue sets, not at a value that the recording gives'
_FittedRow = tuple[str, str, list[FittedValue]]  # label, unit, values by group
_DIGITS = {'r2': 3, 'rmse_w': 2, 'bias_w': 2, 'error_j': 0, 'energy_j': 0}
_VERDICT_STYLE = {
    'named': 'bold green',
    'ambiguous': 'bold yellow',
    'none_of_the_above': 'bold red',
    'no_evidence': 'bold cyan',
}


def print_model(console: Console, model: EffectModel) -> None:
    """Print coefficients and errors of the measurement with 95 % intervals."""
    console.print(f'active effects: {", ".join(model.effects)}')
    if model.base:
        console.print(f'on top of {model.base}')
    coefficients: list[_FittedRow] = []
    for active in model.structure.free:
        shape = ', '.join(f'{k} {v:g}' for k, v in active.shape)
        for index, term in enumerate(active.effect.terms):
            label = f'{active.name} {term.symbol}' + (f' [{shape}]' if shape else '')
            values = [group.coefficients[active.name][index] for group in model.groups]
            coefficients.append((label, term.unit, values))
    known = builtin_catalogue()
    errors = [
        (name, known[name].terms[0].unit, [group.measurement[name] for group in model.groups])
        for name in (model.groups[0].measurement if model.groups else ())
    ]
    groups = [group.type.name for group in model.groups]
    console.print(_fitted_table(f'{model.name}: coefficients', 'effect', coefficients, groups))
    for line in fitted_in_owners_terms(model):
        console.print(line)
    if errors:
        console.print(_fitted_table('errors of the measurement', 'error', errors, groups))
    if model.at_bound:
        console.print(f'{_AT_BOUND}: {", ".join(model.at_bound)}')
    shown = [one for *_, values in (*coefficients, *errors) for one in values]
    if any(_mark(one) == '~' for one in shown):
        console.print(_AT_END)
    for group, part, whole in model.stranded:
        console.print(
            f'{group}: {part} is a part of {whole}, which is 0 here: the two trade off in this '
            f'recording, and neither says what its name says; leave {part} out'
        )


def _fitted_table(
    title: str, head: str, rows: Sequence[_FittedRow], groups: Sequence[str]
) -> Table:
    long = len(groups) > _ABREAST
    columns = (head, 'unit', *(('drive', 'value') if long else groups))
    table = ruled_table(f'{title} with 95 % intervals', columns, (head, 'unit', 'drive'))
    for label, unit, values in rows:
        cells = [
            '{:.3g}{}\n({:.3g} … {:.3g})'.format(one.value, _mark(one), *one.interval)
            for one in values
        ]
        if not long:
            table.add_row(label, unit, *cells)
            continue
        for place, (group, cell) in enumerate(zip(groups, cells, strict=True)):
            heads = ('', '') if place else (label, unit)
            table.add_row(*heads, group, cell.replace('\n', ' '))
    return table


def print_comparison(console: Console, content: dict[str, Any]) -> None:
    """Print errors by model and drive, and where they are worst; content: of `Comparison.json`."""
    columns = ('model', 'drive', 'R²', 'RMSE W', 'bias W', 'energy J', 'of J')
    table = ruled_table(f'held-out errors over {content["extent"]}', columns, ('model', 'drive'))
    for model in content['models']:
        rows = [*model['drives'].items(), ('total', model['total'])]
        for index, (drive, scores) in enumerate(rows):
            name = '' if index else f'{model["name"]} ({model["held_out"]})'
            cells = (
                '–' if scores[key] is None else f'{scores[key]:.{digits}f}'
                for key, digits in _DIGITS.items()
            )
            table.add_row(name, drive, *cells, end_section=index == len(rows) - 1)
    console.print(table)
    for model in content['models']:
        if model['effects']:
            console.print(f'{model["name"]}: active effects {", ".join(model["effects"])}')
        if model['at_bound']:
            console.print(f'{_AT_BOUND}: {", ".join(model["at_bound"])}')
        if model['regimes']:
            console.print(f'{model["name"]} fails most at')
        for regime in model['regimes'][:3]:
            rows, points = regime['rows'], content['operating_points']
            extent = f'{rows} points' if points else f'{rows / REDUCED_RATE:.0f} s'
            console.print(f'  {regime["text"]} ({extent})')
    for both in content['both_sides'].values():
        console.print('\n'.join(both['text']))


def print_outcome(console: Console, outcome: Outcome) -> None:
    """Print verdict, candidates, errors of the measurement, and what to record next."""
    content = outcome.json()
    if outcome.headline:
        console.print(f'[bold]measurement[/]: {outcome.headline}')
    style = _VERDICT_STYLE[content['verdict']]
    console.print(f'[{style}]{content["verdict"]}[/]: {content["sentence"]}')
    for note in content['notes'][bool(outcome.headline) :]:
        console.print(note)
    console.print(f'active effects: {", ".join(content["active"]) or "none"}')
    title = 'candidates: probability that each is missing, and watts that it explains'
    columns = ('effect', 'probability', 'W', '95 %', 'share', 'alone W', 'coefficient')
    table = ruled_table(title, columns, ('effect', 'coefficient'))
    shown = candidates_to_show(outcome.diagnosis)
    for one in shown:
        low, middle, high = one.explains
        table.add_row(
            one.name,
            certainty(one.probability),
            f'{middle:.3f}',
            f'{low:.2g} … {high:.2g}',
            f'{one.share:.0%}',
            f'{one.delta_rmse_w:.3f}',
            f'{one.drive}: {one.in_words}',
        )
    console.print(table)
    if more := len(outcome.diagnosis.candidates) - len(shown):
        console.print(f'and {more} less probable; all are in --json and --report')
    title = 'measurement: error if its faults are ignored'
    texts = ('value', '95 % interval', 'significant')
    terms = ruled_table(title, ('error', 'W', *texts), ('error', *texts))
    for name, term in content['measurement'].items():
        low, high = term['interval']
        unit = '' if term['unit'] == '1' else term['unit']
        terms.add_row(
            name,
            f'{term["watts"]:.2f}',
            f'{term["value"]:.3g} {unit}',
            f'{low:.3g} … {high:.3g} ({term["drive"]})',
            'yes' if term['matters'] else '',
        )
    console.print(terms)
    for regime in outcome.judged.comparison.regimes[0][:3]:
        console.print(f'the model fails at {regime.text}')
    motion = outcome.motion
    console.print(f'to record next ({motion.seconds:.0f} s): {motion.reason}')


def _mark(one: FittedValue) -> str:
    low, high = one.interval
    return '*' if one.at_bound else '~' if low < high and one.value in (low, high) else ''


def print_discovery(console: Console, outcome: DiscoveryOutcome) -> None:
    """Print what was found: a sentence, a line for each effect and drive, then its formulas."""
    console.print(escape(outcome.sentence), style='bold')
    if not outcome.discovery.found:
        return
    table = Table(box=None)
    for name in ('effect', 'kind', 'drive'):
        table.add_column(name, no_wrap=True)
    for name in ('explains', '95 %', 'transfers'):
        table.add_column(name, justify='right', no_wrap=True)
    names = outcome.own.prepared.names
    for one, transfer in zip(outcome.discovery.found, outcome.transfers, strict=True):
        told = None if transfer is None else transfer.transfers
        word = {None: '–', True: 'yes', False: 'no'}[told]
        own = [
            (escape(printable(names[d])), max(float(one.gain[d]), 0.0) ** 0.5) for d in one.drives
        ]
        rows = own if len(own) == 1 else [('rms of all', one.explains), *own]
        interval = '{:.2f}–{:.2f} W'.format(*one.interval)
        for place, (who, watts) in enumerate(rows):
            shown = ('',) * 4 if place else (escape(one.name), one.kind, interval, word)
            table.add_row(*shown[:2], who, f'{watts:.2f} W', *shown[2:])
    console.print(table)
    for one in outcome.discovery.found:
        if one.formula is not None:
            for drive in one.drives:
                formula = printable(one.formula.text(drive))
                console.print(escape(f'{one.name} on {printable(names[drive])}: {formula}'))


def power_balances(data: AlignedDataset) -> dict[str, ShaftBalance]:
    """Regress metered on shaft power for each metered drive, or for `robot` where none has one."""
    power, supply, torque, velocity = (
        each.astype(np.float64) for each in (data.power, data.supply, data.torque, data.velocity)
    )
    columns = {name: data.names.index(name) for name in data.measured_drives()}
    found = {
        name: power_balance(power[:, column], torque[:, column], velocity[:, column])
        for name, column in columns.items()
    } or {'robot': power_balance(supply, torque, velocity)}
    return {name: balance for name, balance in found.items() if balance is not None}


def balance_lines(data: AlignedDataset, balances: Mapping[str, ShaftBalance]) -> list[str]:
    """Return a line of text for each balance, with its unit where current stands for torque."""
    current = set(data.current_as_torque)
    lines = []
    for name, balance in balances.items():
        text = str(balance)
        if name in current or (name == 'robot' and current):
            text = text.replace('W per W of torque', 'W per A·rad/s of current')
        lines.append(f'power balance of {name}: {text}')
    return lines


def balances_json(balances: Mapping[str, ShaftBalance]) -> dict[str, dict[str, float]]:
    """Return by drive: slope W/W, its standard error, share of the variance and R², for JSON."""
    fields = ('slope', 'error', 'share', 'r2')
    return {
        name: {field: float(np.round(getattr(balance, field), 6)) for field in fields}
        for name, balance in balances.items()
    }
