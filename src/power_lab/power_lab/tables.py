"""Results as tables on a terminal."""

from typing import Any

from power_estimator.effect_model import EffectModel
from rich.console import Console
from rich.table import Table

from power_lab.judge import Outcome
from power_lab.verdict import plain

_VERDICT_STYLE = {
    'named': 'bold green',
    'ambiguous': 'bold yellow',
    'none_of_the_above': 'bold red',
    'no_evidence': 'bold cyan',
}


def print_model(console: Console, model: EffectModel) -> None:
    """Coefficients with intervals."""
    console.print(f'active effects: {", ".join(model.effects)}')
    if model.base:
        console.print(f'on top of {model.base}')
    table = Table(title=f'{model.name}: coefficients with 95 % intervals')
    table.add_column('effect')
    table.add_column('unit')
    for group in model.groups:
        table.add_column(group.type.name, justify='right')
    for active in model.structure.free:
        for index, term in enumerate(active.effect.terms):
            cells = []
            for group in model.groups:
                value = group.coefficients[active.name][index]
                low, high = value.interval
                cells.append(f'{value.value:.4g} ({low:.4g} … {high:.4g})')
            shape = ', '.join(f'{k} {v:g}' for k, v in active.shape)
            label = f'{active.name} {term.symbol}' + (f' [{shape}]' if shape else '')
            table.add_row(label, term.unit, *cells)
    console.print(table)


def print_comparison(console: Console, content: dict[str, Any]) -> None:
    """Errors by model and drive, and where they are worst."""
    table = Table(title=f'held-out errors over {content["seconds"]:.0f} s')
    for column in ('model', 'drive', 'R²', 'RMSE W', 'bias W', 'energy J', 'of J'):
        table.add_column(column, justify='left' if column in ('model', 'drive') else 'right')
    for model in content['models']:
        rows = [*model['drives'].items(), ('total', model['total'])]
        for index, (drive, scores) in enumerate(rows):
            table.add_row(
                f'{model["name"]} ({model["held_out"]})' if index == 0 else '',
                drive,
                _number(scores['r2'], 3),
                _number(scores['rmse_w'], 2),
                _number(scores['bias_w'], 2),
                _number(scores['error_j'], 0),
                _number(scores['energy_j'], 0),
                end_section=index == len(rows) - 1,
            )
    console.print(table)
    for model in content['models']:
        if model['effects']:
            console.print(f'{model["name"]}: active effects {", ".join(model["effects"])}')
        for regime in model['regimes'][:3]:
            console.print(f'  {regime["text"]} ({regime["seconds"]:.0f} s)')


def print_outcome(console: Console, outcome: Outcome) -> None:
    """Verdict, candidates, measurement, what to record next."""
    content = outcome.json()
    style = _VERDICT_STYLE[content['verdict']]
    console.print(f'[{style}]{content["verdict"]}[/]: {content["sentence"]}')
    console.print(f'active effects: {", ".join(content["active"]) or "none"}')
    table = Table(title='candidates, best first')
    for column in ('effect', 'error falls by W', 'R² gains', 'coefficient', '95 % interval', 'of'):
        table.add_column(column, justify='left' if column in ('effect', 'of') else 'right')
    table.add_column('may be it', justify='center')
    for row in content['candidates']:
        low, high = row['interval']
        table.add_row(
            plain(row['name']),
            f'{row["delta_rmse_w"]:.3f}',
            f'{row["delta_r2"]:.5f}',
            f'{row["symbol"]} = {row["coefficient"]:.4g} {row["unit"]}',
            f'{low:.4g} … {high:.4g}',
            row['drive'],
            'yes' if row['in_confidence_set'] else '',
        )
    console.print(table)
    terms = Table(title='measurement')
    for column in ('error', 'value', '95 % interval', 'costs W', 'matters'):
        terms.add_column(column, justify='left' if column == 'error' else 'right')
    for name, term in content['measurement'].items():
        low, high = term['interval']
        terms.add_row(
            f'{name} ({term["drive"]})',
            f'{term["value"]:.4g} {term["unit"]}',
            f'{low:.4g} … {high:.4g}',
            f'{term["watts"]:.2f}',
            'yes' if term['matters'] else 'no',
        )
    console.print(terms)
    for regime in (outcome.base_regimes or ())[:3]:
        console.print(f'where the model failed: {regime.text}')
    motion = outcome.motion
    console.print(f'to record next ({motion.seconds:.0f} s): {motion.reason}')


def _number(value: float | None, digits: int) -> str:
    return '–' if value is None else f'{value:.{digits}f}'
