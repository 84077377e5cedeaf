"""The time of a log as a guessed map has it: a column, several that are added, a rate or none."""

import re
from collections.abc import Sequence
from typing import Final

import numpy as np
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import printable

from power_recordings.importing.candidates import MECHANICAL, CandidateColumn, by_ones
from power_recordings.importing.listing import Listed
from power_recordings.importing.times import is_date, is_time_of_day
from power_recordings.importing.words import words, yaml_text

_TIMES: Final = {'s': 1.0, 'ms': 1e-3, 'us': 1e-6, 'ns': 1e-9}
_RATES: Final = (5.0, 2e4)  # Hz
_FEWEST, _EVEN = 30, 3.0  # rows of a column that is a time by its steps, and their ratio
_SERIES: Final = 2000  # rows, more than points are measured by hand or in a grid
_MOSTLY, _STEP = 0.99, 0.5  # share of rows, and of the spread, that a motion goes on by at most
_OTHERS: Final = 2  # columns that are named beside the one that was taken
_PERIOD: Final = "{{column: {}, unit: 'PERIOD ms'}}"
_MILLI: Final = r'milli_?seconds?|milli_?secs?|msecs?|ms'


def time_line(found: Sequence[CandidateColumn], listed: Sequence[Listed]) -> str:
    """Return a guessed map's entry `time` as YAML; found: candidates among columns `listed`."""
    times = [c for c in found if c.quantity == 'time' and _ascends(c)]
    if not times and listed and all(c.listed != listed[0] for c in found) and _ticks(listed[0]):
        times = [CandidateColumn('time', 0, '', listed[0])]
    names = {words(c.address).replace('_', ''): c for c in found if c.quantity == 'time'}
    whole = next((c for n, c in names.items() if n in ('sec', 'secs', 'seconds', 's')), None)
    rest = next((c for n, c in names.items() if n in ('nsec', 'nsecs', 'nanosec', 'ns')), None)
    if whole is not None and rest is not None:
        both = [(whole.listed, 's'), (rest.listed, 'ns')]
        return _added(both, 'seconds and nanoseconds, by name')
    clock = next((item for item in listed if is_time_of_day(item.text)), None)
    if clock is not None:
        dates = [item for item in listed if is_date(item.text)][:1]
        milli = [item for item in listed if _is_milli(item)][:1]
        parts = [*((d, '') for d in dates), (clock, ''), *((m, 'ms') for m in milli)]
        if len(parts) > 1:
            return _added(parts, 'parts of a time, added')
        if not times and clock.changes > 0:
            return f'time: {{column: {yaml_text(clock.column.address)}}}   # times of day'
    motion = [c for c in found if c.quantity in MECHANICAL]
    used = [c.listed for c in found]
    counter = next((n for n in listed if n not in used and _counts_cycles(n)), None)
    period = '' if counter is None else _PERIOD.format(yaml_text(counter.column.address))
    if not times and motion and all(map(_follow, motion)):
        if period:
            return f'time: {period}   # it counts the rows: fill in the period of one, as 2 ms'
        return (
            'time: {column: COLUMN, unit: s}   # no column looks like one: fill in; of a log at a '
            'fixed rate: {rate: 100}; where each row is an operating point: {steady: true}'
        )
    if not times:
        return (
            'time: {steady: true}   # no column looks like a time: each row an operating point; '
            'of a log at a fixed rate: {rate: 100}'
            + (f', or of counts: {period}' if period else '')
        )
    best = _best(times)
    unit, why = (best.unit, '') if best.unit else _time_unit(best)
    known = best.values[np.isfinite(best.values)]
    rows = len(known)
    seconds = float(np.ptp(known)) * _TIMES.get(unit, 1.0) if rows else 0.0
    if best.listed.changes < 0.5 and seconds > 0 and best.listed.changes * rows < seconds * 25:
        return (
            f'time: {{rate: {rows / seconds:.4g}}}   # rows over time: {best.address} changes in '
            f'{best.listed.changes:.0%} of the rows only'
        )
    others = [c.address for c in times if c != best][:_OTHERS]
    or_others = f'or {printable(", ".join(others))}' if others else ''
    notes = [text for text in (why, or_others) if text]
    note = f'   # {"; ".join(notes)}' if notes else ''
    return f'time: {{column: {yaml_text(best.address)}, unit: {unit}}}{note}'


def row_times(found: Sequence[CandidateColumn]) -> Floats:
    """Return the times of the first rows, s [N], by the column that `time_line` takes; else []."""
    times = [c for c in found if c.quantity == 'time' and _ascends(c)]
    if not times:
        return np.zeros(0)
    unit = _best(times).unit or _time_unit(_best(times))[0]
    return _best(times).values * _TIMES.get(unit, np.nan)


def _best(times: Sequence[CandidateColumn]) -> CandidateColumn:
    return min(times, key=lambda c: (_counts(c), -round(c.listed.changes, 1), len(c.address)))


def _ascends(candidate: CandidateColumn) -> bool:
    """Tell whether a column goes on as a time does; dates and what no row tells of count."""
    values = candidate.values[np.isfinite(candidate.values)]
    return len(values) < 2 or bool((np.diff(values) >= 0).mean() > 0.9)


def _added(parts: Sequence[tuple[Listed, str]], why: str) -> str:
    columns = ', '.join(
        f'{{from: {yaml_text(item.column.address)}' + (f', unit: {unit}}}' if unit else '}')
        for item, unit in parts
    )
    return f'time: {{columns: [{columns}]}}   # {why}'


def _is_milli(item: Listed) -> bool:
    """Tell whether a column counts the milliseconds of a second."""
    named = re.search(_MILLI, words(item.column.address)) is not None
    return named and 0 <= item.low <= item.high < 1000


def _ticks(first: Listed) -> bool:
    """Tell whether the first column of a table goes on in even steps, and not by ones."""
    steps = np.diff(first.values)
    if len(steps) < _FEWEST or not (steps > 0).all() or by_ones(steps):
        return False
    return float(np.quantile(steps, 0.9)) < _EVEN * float(np.quantile(steps, 0.1))


def _follow(candidate: CandidateColumn) -> bool:
    """Tell whether the rows of a motion go on from one another, and are more than any table's."""
    known = candidate.values[np.isfinite(candidate.values)]
    if len(known) < _SERIES:
        return False
    steps = np.abs(np.diff(known))
    return bool(np.quantile(steps, _MOSTLY) < _STEP * np.std(known))


def _counts_cycles(item: Listed) -> bool:
    """Tell whether a column goes up with each row, nearly always by one: a few were lost."""
    steps = np.diff(item.values)
    rises = len(steps) >= _FEWEST and bool((steps > 0).all())
    return rises and not item.column.unit and by_ones(steps)


def _counts(candidate: CandidateColumn) -> bool:
    """Tell whether a column numbers the rows."""
    known = candidate.values[np.isfinite(candidate.values)]
    return len(known) > 1 and bool((np.diff(known) == 1.0).all())


def _time_unit(candidate: CandidateColumn) -> tuple[str, str]:
    """The unit in a name, or the one that makes a likely rate."""
    named = [part for part in words(candidate.address).split('_') if part in _TIMES]
    if named:
        return named[0], f'{named[0]} by its name'
    steps = np.diff(candidate.values)
    steps = steps[steps > 0]
    if not len(steps):
        return 's', ''
    for unit, factor in _TIMES.items():
        if _RATES[0] <= (rate := 1 / (float(np.median(steps)) * factor)) <= _RATES[1]:
            return unit, f'{unit} makes {rate:.3g} rows a second'
    return 's', 'unit not stated: check'
