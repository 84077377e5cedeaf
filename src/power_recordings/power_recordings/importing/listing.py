"""Columns of a log with their units, ranges, rates and changes, as `import --list` shows them."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from wattwalk_core.arrays import Floats

from power_recordings.importing.channel_group import LARGEST
from power_recordings.importing.map_file import ImportMap
from power_recordings.importing.plan import ImportPlan, LogChannel, make_plan
from power_recordings.importing.sources.source import (
    LogColumn,
    LogSource,
    first_rows,
    first_values,
)
from power_recordings.importing.times import LogClock
from power_recordings.importing.units import SI

_ROWS = 50_000  # of each stream that are looked at
_CELLS = 25_000_000
_KEPT = 20_000  # rows that guesses are judged by
_LATEST_NS = 9.3e18  # in the year 2262, the most of 64 bits


@dataclass(frozen=True)
class Listed:
    """A column with the statistics of its first rows; NaN if none holds a number."""

    column: LogColumn
    rows: int
    low: float
    high: float
    changes: float  # share of rows whose value differs from the row before
    rate: float  # rows a second, for bags
    values: Floats = field(default_factory=lambda: np.zeros(0))  # first rows
    text: str = ''  # the first, of a column of texts


def extent(listed: Sequence[Listed]) -> str:
    """Return `of the first N rows of M` if only a part of the log was read, else ''."""
    counts = [(item.rows, item.column.rows) for item in listed]
    part = [(n, m) for n, m in counts if n < (m or 0) or (m is None and n >= _ROWS)]
    if not part:
        return ''
    rows, whole = max(part, key=lambda pair: pair[0])
    return f'of the first {rows:,} rows' + (f' of {whole:,}' if whole else '')


def list_columns(source: LogSource) -> list[Listed]:
    """Read the first rows (about 50,000) of each column; InputError for an unreadable log."""
    columns = source.columns()
    known = {column.address: column for column in columns}
    parts: dict[str, list[np.ndarray]] = defaultdict(list)
    stamps: dict[str, list[np.ndarray]] = defaultdict(list)
    blocks = source.read([*known], lambda done: None)
    for block in first_rows(blocks, columns, min(_ROWS, _CELLS // max(len(columns), 1))):
        for address, values in block.values.items():
            parts[address].append(values)
        if block.log_ns is not None:
            own = block.header_ns
            stamps[block.stream].append(own if own is not None and own.any() else block.log_ns)
    found, ended = {}, next(blocks, None) is None
    for address, arrays in parts.items():
        column, values = known[address], np.concatenate(arrays)
        column = replace(column, rows=len(values)) if ended else column
        steps = np.diff(np.concatenate(stamps.get(column.stream, [np.zeros(0)]))) / 1e9
        rate = 1 / float(np.median(steps)) if len(steps) and np.median(steps) > 0 else np.nan
        found[address] = _listed(column, values, rate)
    return [found.get(c.address, Listed(c, 0, np.nan, np.nan, 0.0, np.nan)) for c in columns]


def _listed(column: LogColumn, values: np.ndarray, rate: float) -> Listed:
    count = len(values)
    if values.dtype.kind == 'O':
        changes = float(np.mean(values[1:] != values[:-1])) if count > 1 else 0.0
        text = next((str(value) for value in values if value), '')
        return Listed(column, count, np.nan, np.nan, changes, rate, text=text)
    if not _may_be_times(values):
        values = np.where(np.abs(values) < LARGEST, values, np.nan)
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (np.nan, np.nan)
    steps = np.diff(finite)
    changes = float(np.mean(steps != 0)) if len(steps) else 0.0
    return Listed(column, count, low, high, changes, rate, values[:_KEPT])


_SHOWN_ROWS = 20_000  # of each stream
_SHOWN = 240  # values of each signal


@dataclass(frozen=True)
class PreviewedSignal:
    """One quantity of a drive, or of the supply ('' for drive), over the first rows."""

    drive: str
    quantity: str
    unit: str
    rows: int
    low: float  # NaN where no row is a number
    high: float
    values: Floats  # evenly thinned out


def preview_log(source: LogSource, mapping: ImportMap, where: str) -> list[PreviewedSignal]:
    """Convert a log's first rows to SI; errors are as of an import and begin with `where`."""
    plan = make_plan(mapping, source.columns(), where, source.is_bag)
    wanted = set(plan.addresses())
    columns = [column for column in source.columns() if column.address in wanted]
    found = first_values(source, columns, _SHOWN_ROWS)
    _check_times(source, plan, found)
    parts: dict[str, Mapping[str, LogChannel]] = {**plan.drives, '': plan.supply}
    return [
        _previewed(drive, quantity, channel, found, plan)
        for drive, channels in parts.items()
        for quantity, channel in channels.items()
    ]


def _check_times(source: LogSource, plan: ImportPlan, found: Mapping[str, Floats]) -> None:
    """InputError where the times of the first rows are of no use, as an import raises it."""
    columns = [found[column.address] for column, _ in plan.time if column.address in found]
    if not columns or len(columns) < len(plan.time):
        return
    clock = LogClock(str(source.path), tuple(unit for _, unit in plan.time))
    clock.order(clock.nanoseconds(columns))
    clock.check()


def _previewed(
    drive: str, quantity: str, channel: LogChannel, found: Mapping[str, Floats], plan: ImportPlan
) -> PreviewedSignal:
    if not channel.terms:
        values = np.array([channel.constant()])
    elif all(address in found for address in channel.addresses):
        values = channel.convert(found)
    else:
        values = np.zeros(0)
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (np.nan, np.nan)
    unit = plan.torque_unit.get(drive, SI[quantity]) if quantity == 'torque' else SI[quantity]
    thinned = values[:: max(1, -(-len(values) // _SHOWN))]
    return PreviewedSignal(drive, quantity, unit, len(values), low, high, thinned)


def _may_be_times(values: np.ndarray) -> bool:
    """Tell whether values go on as times in ns since 1970 do, which are larger than any signal."""
    finite = values[np.isfinite(values)]
    steps = np.diff(finite)
    return bool(steps.any() and finite.max() < _LATEST_NS and np.mean(steps >= 0) > 0.9)
