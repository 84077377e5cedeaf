"""Figures of reliability and coverage from rows of results, with their confidence intervals."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

from rich.table import Table
from scipy.stats import binomtest

Row = dict[str, Any]
BINS = ((0.5, 0.8), (0.8, 0.95), (0.95, 1.0000001))
FLOOR = 0.05
"""Share of the rms power from which a hidden effect counts as large enough to be found."""
COLUMNS = (('developed on', True), ('not developed on', False))


def share(hits: int, count: int) -> str:
    """Write a share with its number and exact interval of 95 %: `0.94 [0.91, 0.96] of 400`."""
    if not count:
        return '–'
    low, high = binomtest(hits, count).proportion_ci()
    return f'{hits / count:.2f} [{low:.2f}, {high:.2f}] of {count}'


def said(rows: Iterable[Row]) -> Iterator[tuple[Row, str, float, bool]]:
    """Yield statements whose truth is known: row, effect, probability and whether it is true."""
    for row in rows:
        for effect, probability in row.get('statements', ()):
            if effect in row['missing'] or row['complete'] or effect in row['impossible']:
                yield row, effect, probability, effect in row['missing']


def covered(rows: Iterable[Row]) -> Iterator[tuple[Row, str, float, bool]]:
    """Yield intervals whose coefficient is known: row, coefficient, level and whether it holds."""
    for row in rows:
        for drive, name, level, low, high in row.get('intervals', ()):
            truth = row['coefficients'].get(drive, {}).get(name)
            if truth is not None:
                yield row, name, level, low <= truth <= high


def reliability(rows: Sequence[Row]) -> Table:
    """Share of true statements by the probability that they were given."""
    table = Table('said', *(name for name, _ in COLUMNS), title='true, of what was said')
    statements = list(said(rows))
    for low, high in BINS:
        cells = []
        for _, developed in COLUMNS:
            own = [
                true
                for row, _, probability, true in statements
                if row['developed'] == developed and low <= probability < high
            ]
            cells.append(share(sum(own), len(own)))
        table.add_row(f'{low:.0%} to {min(high, 1):.0%}', *cells)
    return table


def coverage(rows: Sequence[Row]) -> Table:
    """Share of intervals that hold the truth, by coefficient and level."""
    table = Table('coefficient', 'level', *(name for name, _ in COLUMNS), title='intervals')
    intervals = list(covered(rows))
    for name in sorted({name for _, name, _, _ in intervals}):
        for level in sorted({level for _, other, level, _ in intervals if other == name}):
            cells = []
            for _, developed in COLUMNS:
                own = [
                    holds
                    for row, other, at, holds in intervals
                    if (other, at, row['developed']) == (name, level, developed)
                ]
                cells.append(share(sum(own), len(own)))
            table.add_row(name, f'{level:.0%}', *cells)
    return table


def by(rows: Sequence[Row], title: str, of: Callable[[Row], object]) -> Table:
    """Figures by a property: wrong of certain statements, coverage of 95 %, found, silent."""
    columns = ('wrong at ≥ 95 %', '95 % intervals hold', 'found at ≥ 95 %', 'nulls left alone')
    table = Table(title, 'recordings', *columns, title=f'by {title}')
    for value in sorted({of(row) for row in rows}, key=_order):
        own = [row for row in rows if of(row) == value]
        certain = [true for _, _, p, true in said(own) if p >= 0.95]
        holds = [inside for _, _, level, inside in covered(own) if level == 0.95]
        found, nulls = list(_found(own)), list(_left_alone(own))
        table.add_row(
            str(value),
            str(len(own)),
            share(len(certain) - sum(certain), len(certain)),
            share(sum(holds), len(holds)),
            share(sum(found), len(found)),
            share(sum(nulls), len(nulls)),
        )
    return table


MEASUREMENT = ('torque_scale', 'power_gain', 'current_offset', 'torque_bias')


def measurement(rows: Sequence[Row]) -> Table:
    """Share of recordings in which an error of the measurement is named, off or not."""
    columns = ('named at ≥ 95 % where it is off', 'at ≥ 50 %', 'named where it is not')
    table = Table('error', *columns, title='errors of the measurement')
    for name in MEASUREMENT:
        off, fine = [], []
        for row in rows:
            said_at = max((p for effect, p in row['statements'] if effect == name), default=0.0)
            if row['complete']:
                (off if name in row['missing'] else fine).append(said_at)
        cells = [share(sum(p >= least for p in off), len(off)) for least in (0.95, 0.5)]
        table.add_row(name, *cells, share(sum(p >= 0.95 for p in fine), len(fine)))
    return table


def beside_hidden(rows: Sequence[Row]) -> Table:
    """Names in logs in which something is hidden, less those of the log as it is."""
    title = 'names in logs that the log as it is does not have'
    table = Table('log', 'of what was hidden', 'of anything else', title=title)
    as_it_is = {
        row['family']: dict(row['statements'])
        for row in rows
        if row['family'].startswith('log ') and not row['hidden']
    }
    for family, stated in sorted(as_it_is.items()):
        new = [
            effect in row['missing']
            for row in rows
            if row['family'] == family and row['hidden']
            for effect, probability in row['statements']
            if effect not in MEASUREMENT and probability >= 0.95 > stated.get(effect, 0.0)
        ]
        table.add_row(family, str(sum(new)), str(len(new) - sum(new)))
    return table


def _order(value: object) -> tuple[bool, Any]:
    return isinstance(value, str), value


def _found(rows: Iterable[Row]) -> Iterator[bool]:
    """Yield for each hidden effect that is large enough whether it, or its family, was named."""
    for row in rows:
        stated = dict(row['statements'])
        for effect, watts in row['watts'].items():
            any_of = set(effect.split('|'))
            large = watts >= 0.999 * FLOOR * row['rms_w'] or effect == row.get('left_out')
            if large and any_of & set(row['missing']):
                yield sum(stated.get(name, 0.0) for name in any_of) >= 0.95


def _left_alone(rows: Iterable[Row]) -> Iterator[bool]:
    """Yield for each recording in which nothing is hidden whether no effect was named."""
    for row in rows:
        if row['complete'] and not row['hidden']:
            names = {effect for effect, probability in row['statements'] if probability >= 0.95}
            yield names <= set(row['missing'])


def tables(rows: Sequence[Row]) -> list[Table]:
    """All tables of the benchmark."""
    good = [row for row in rows if 'error' not in row]
    return [
        reliability(good),
        coverage(good),
        measurement(good),
        beside_hidden(good),
        by(good, 'family', lambda row: row['family']),
        by(good, 'length', lambda row: row['seconds']),
        by(good, 'drives', lambda row: row['drives']),
        by(good, 'rate', lambda row: row['rate']),
        by(good, 'motion', lambda row: row['motion']),
        by(good, 'hidden', lambda row: ' + '.join(row['hidden']) or 'nothing'),
    ]
