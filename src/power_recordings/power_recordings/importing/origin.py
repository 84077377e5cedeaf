"""The origin of a log's powers: a meter, or a formula of the firmware that wrote it."""

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice, product
from typing import Final

import numpy as np
from wattwalk_core.arrays import Floats

from power_recordings.importing.plan import ImportPlan, LogChannel
from power_recordings.importing.sources.source import LogSource, first_values
from power_recordings.importing.times import LogClock
from power_recordings.importing.words import axis_of, is_motor_current, kind_of

_EXACT: Final = 0.9995  # R²
_FACTORS: Final = (1.0, 1.5)  # of amplitudes in a rotating frame; of DC
_ROUND: Final = 0.01
_FEWEST: Final = 50  # rows
_MOST: Final = 200  # formulas that are tried
_WATT_HOURS: Final = 3600.0  # J
_AGREES: Final = 0.05
_NOT_DRAWN: Final = r'charged|regen|returned|batt|left|remain|capacity'  # in names of counters


def recognise(
    power: Floats, columns: Mapping[str, Floats], meter: Sequence[str] = ()
) -> str | None:
    """Return the formula by which a power [N] was computed from other columns [N], else None.

    It is a factor times a sum of products of columns, with the R² of the fit. meter: the columns
    that the power is mapped from; their product does not count as a formula.
    """
    best, highest = None, 0.0
    for terms in islice(_formulas(columns), _MOST):
        if all(set(term) <= set(meter) for term in terms):
            continue
        value = sum(np.prod([columns[name] for name in term], axis=0) for term in terms)
        factor, r2 = _fits(power, np.asarray(value, np.float64)) or (0.0, 0.0)
        if r2 > highest:
            inner = ' + '.join(' × '.join(term) for term in terms)
            inner = f'{factor:g} × ({inner})' if factor != 1.0 else inner
            best, highest = f'{inner} (R² {min(r2, 0.9999):.4f})', r2
    return best


def _formulas(columns: Mapping[str, Floats]) -> Iterator[tuple[tuple[str, ...], ...]]:
    kinds = {name: kind_of(name) for name in columns}
    volts = [name for name, kind in kinds.items() if kind == 'voltage']
    amps = [name for name, kind in kinds.items() if kind == 'current']
    duties = [name for name, kind in kinds.items() if kind == 'duty']
    by_axis = {a: [[n for n in those if axis_of(n) == a] for those in (volts, amps)] for a in 'qd'}
    yield from product(product(*by_axis['q']), product(*by_axis['d']))
    yield from (((v, d, i),) for v, d, i in product(volts, duties, amps))
    yield from (((v, i),) for v, i in product(volts, filter(is_motor_current, amps)))


def _fits(power: Floats, value: Floats) -> tuple[float, float] | None:
    good = np.isfinite(power) & np.isfinite(value)
    p, x = power[good], value[good]
    if len(p) < _FEWEST or not np.var(p) > 0 or not np.var(x) > 0:
        return None
    factor = float(x @ p / (x @ x))
    nearest = min(_FACTORS, key=lambda f: abs(factor / f - 1))
    r2 = 1 - float(np.mean(np.square(p - factor * x))) / float(np.var(p))
    return (nearest, r2) if r2 > _EXACT and abs(factor / nearest - 1) < _ROUND else None


def check_energy(seconds: Floats, power: Floats, columns: Mapping[str, Floats]) -> str:
    """Compare the integral of a power [N, W] over times [N, s] with the log's energy counter.

    Returns a sentence with both energies, their ratio, and whether they agree. columns: [N] by
    name, in the log's units. '' without a counter that advances, for times that go back, or for
    fewer than 50 rows.
    """
    counters = {name: values for name, values in columns.items() if kind_of(name) == 'energy'}
    used = [n for n in counters if not re.search(_NOT_DRAWN, n, re.I)]
    if not used:
        return ''
    name = min(used, key=lambda n: (_returned(n) not in counters, len(n)))
    back = _returned(name) if _returned(name) in counters else ''
    total = counters[name] - (counters[back] if back else 0.0)
    good = np.isfinite(seconds) & np.isfinite(power) & np.isfinite(total)
    t, p, energy = seconds[good], power[good], total[good]
    if len(t) < _FEWEST or energy[-1] == energy[0] or (np.diff(t) < 0).any():
        return ''
    label = f'{name} − {back}' if back else name
    unit = {'joule': 1.0 / _WATT_HOURS, 'kwh': 1000.0}
    scale = next((size for word, size in unit.items() if word in name.lower()), 1.0)
    counted = scale * float(energy[-1] - energy[0])
    integral = float(np.trapezoid(p, t)) / _WATT_HOURS
    ratio = integral / counted
    agree = 'agree' if abs(ratio - 1) < _AGREES else 'do not agree: another unit, sign or drive?'
    return (
        f'{label} counts {counted:.4g} Wh, the integral of the power is {integral:.4g} Wh '
        f'(ratio {ratio:.3f}): they {agree}'
    )


def _returned(name: str) -> str:
    """The counter of what was given back, beside one of what was used."""
    return name.replace('used', 'charged') if 'used' in name else ''


_ROWS: Final = 50_000  # that are looked at
_COLUMNS: Final = 60  # that a power may be computed from


def origin_of_power(source: LogSource, plan: ImportPlan) -> tuple[dict[str, str], list[str]]:
    """Return formulas by drive of powers that a firmware computed, and notes on energy counters.

    Judged by the first rows of a table; empty for a bag.
    """
    metered = {
        drive: channels
        for drive, channels in plan.drives.items()
        if {'current', 'power'} & set(channels)
    }
    if source.is_bag or not metered:
        return {}, []
    mapped = plan.addresses()
    telling = [c.address for c in source.columns() if kind_of(c.address, c.unit)]
    wanted = [c for c in source.columns() if c.address in {*mapped, *telling[:_COLUMNS]}]
    wanted.sort(key=lambda column: column.address not in mapped)
    columns = first_values(source, wanted, _ROWS)
    formulas, notes = {}, list[str]()
    for drive, channels in metered.items():
        power, made_of = _power(channels, columns)
        if power is None:
            continue
        others = {name: v for name, v in columns.items() if len(v) == len(power)}
        found = recognise(power, others, made_of)
        if found is not None:
            formulas[drive] = found
        seconds = _seconds(source, plan, others)
        if len(metered) == 1 and seconds is not None:
            notes += filter(None, [check_energy(seconds, power, others)])
    return formulas, notes


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
