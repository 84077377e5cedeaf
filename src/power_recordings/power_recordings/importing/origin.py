"""The origin of a log's powers: a meter, or a formula of the firmware that wrote it."""

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from power_recordings.importing.formula import check_energy, recognise
from power_recordings.importing.plan import ImportPlan, LogChannel
from power_recordings.importing.sources.source import LogSource
from power_recordings.importing.times import LogClock
from power_recordings.importing.words import kind_of

Floats = NDArray[np.float64]

_ROWS: Final = 50_000  # that are looked at
_COLUMNS: Final = 60  # that a power may be computed from


def origin_of_power(source: LogSource, plan: ImportPlan) -> tuple[dict[str, str], list[str]]:
    """
    Return the formulas of the drives whose power is computed, and notes on energy counters.

    The first rows of a table are looked at; the topics of a bag are not.
    """
    metered = {
        drive: channels
        for drive, channels in plan.drives.items()
        if {'current', 'power'} & set(channels)
    }
    if source.is_bag or not metered:
        return {}, []
    columns = _first_rows(source, plan)
    formulas, notes = {}, []
    for drive, channels in metered.items():
        power, made_of = _power(channels, columns)
        if power is None:
            continue
        others = {name: v for name, v in columns.items() if len(v) == len(power)}
        found = recognise(power, others, made_of)
        if found is not None:
            formulas[drive] = found.text
        seconds = _seconds(source, plan, others)
        if len(metered) == 1 and seconds is not None:
            energy = check_energy(seconds, power, others)
            notes += [energy.text] if energy is not None else []
    return formulas, notes


def _first_rows(source: LogSource, plan: ImportPlan) -> dict[str, Floats]:
    mapped = {
        a for channels in plan.drives.values() for c in channels.values() for a in c.addresses
    }
    mapped |= {column.address for column, _ in plan.time}
    telling = [c.address for c in source.columns() if kind_of(c.address, c.unit)]
    wanted = [*mapped, *(a for a in telling[:_COLUMNS] if a not in mapped)]
    parts: dict[str, list[Floats]] = {}
    rows = 0
    for block in source.read(wanted, lambda done: None):
        for address, values in block.values.items():
            if values.dtype.kind != 'O':
                parts.setdefault(address, []).append(values)
        rows += len(block)
        if rows >= _ROWS:
            break
    return {address: np.concatenate(arrays)[:_ROWS] for address, arrays in parts.items()}


def _power(
    channels: Mapping[str, LogChannel], columns: Mapping[str, Floats]
) -> tuple[Floats | None, tuple[str, ...]]:
    """Power in W, and the columns that it is made of."""
    wanted = [channels[q] for q in ('power',) if q in channels]
    wanted = wanted or [channels[q] for q in ('current', 'voltage')]
    made_of = tuple(a for channel in wanted for a in channel.addresses)
    if not made_of or not all(address in columns for address in made_of):
        return None, ()
    values = [c.convert(columns) if c.terms else np.asarray(c.constant()) for c in wanted]
    return np.asarray(np.prod(np.broadcast_arrays(*values), axis=0), np.float64), made_of


def _seconds(source: LogSource, plan: ImportPlan, columns: Mapping[str, Floats]) -> Floats | None:
    if not plan.time or not all(column.address in columns for column, _ in plan.time):
        return None
    clock = LogClock(f'{source.path}', tuple(unit for _, unit in plan.time))
    stamps = clock.nanoseconds([columns[column.address] for column, _ in plan.time])
    return np.where(stamps >= 0, (stamps - stamps[0]) / 1e9, np.nan)
