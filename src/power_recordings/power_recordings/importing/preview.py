"""First rows of a log as a map converts them, to be looked at before an import."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from wattwalk_core.arrays import Floats

from power_recordings.importing.map_file import ImportMap
from power_recordings.importing.plan import ImportPlan, LogChannel, make_plan
from power_recordings.importing.sources.source import LogSource, first_values
from power_recordings.importing.times import LogClock
from power_recordings.importing.units import SI

_ROWS = 20_000  # of each stream
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
    """Convert the first rows; InputError, which begins with where, as an import raises it."""
    plan = make_plan(mapping, source.columns(), where, source.is_bag)
    wanted = set(plan.addresses())
    columns = [column for column in source.columns() if column.address in wanted]
    found = first_values(source, columns, _ROWS)
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
