"""From a map and the columns of a log to what is read, converted and written."""

import difflib
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError, printable, quoted

from power_recordings.importing.map_file import (
    GEARED,
    DriveMap,
    ImportMap,
    Signal,
    load_map,
    names,
)
from power_recordings.importing.sources.heads import unit_of
from power_recordings.importing.sources.source import LogColumn, LogSource
from power_recordings.importing.units import Conversion, conversion

_LONGEST = 100  # characters of addresses that are compared
_MOST_COMPARED = 2000
_LONGEST_MATCHED = 500


@dataclass(frozen=True)
class LogChannel:
    """One quantity of a drive or of the supply: its columns and conversion.

    terms: columns, all of one stream, of each product to be added; empty for a constant `value`.
    """

    quantity: str
    terms: tuple[tuple[LogColumn, ...], ...]
    conversion: Conversion
    value: float = np.nan
    positive: str = 'drawn'  # in the map
    unit: str = ''  # in the map or in the log
    scale: float = 1.0  # in the map

    @property
    def addresses(self) -> tuple[str, ...]:
        """Addresses of the columns, each once."""
        return tuple(dict.fromkeys(column.address for term in self.terms for column in term))

    @property
    def stream(self) -> str | None:
        """Stream (group of columns with common times) of the columns; None for a constant."""
        return self.terms[0][0].stream if self.terms else None

    @property
    def formula(self) -> str:
        """Column names of the log, joined by + and ×."""
        return ' + '.join(' × '.join(column.address for column in term) for term in self.terms)

    def convert(self, values: Mapping[str, NDArray[Any]]) -> Floats:
        """Return the quantity in SI [N] from columns [N] by address; InputError for texts."""
        for address in self.addresses:
            if values[address].dtype.kind == 'O':
                raise InputError(f'column {address!r} holds texts; expected numbers')
        products = (
            reduce(np.multiply, (values[column.address] for column in term)) for term in self.terms
        )
        return self.conversion(reduce(np.add, products))

    def constant(self) -> float:
        """Return the constant's value in SI; NaN if the quantity is measured."""
        return float(self.conversion(np.array([self.value]))[0])


@dataclass(frozen=True)
class ShaftPower(LogChannel):
    """Power that a drive draws for torque × speed at an efficiency, or with a loss in W.

    A drive that brakes returns torque × speed × efficiency. parts: torque, speed, and efficiency
    or loss.
    """

    parts: tuple[LogChannel, LogChannel, LogChannel] = field(kw_only=True)

    @property
    def addresses(self) -> tuple[str, ...]:
        """Addresses of the columns."""
        return tuple(dict.fromkeys(a for part in self.parts for a in part.addresses))

    @property
    def formula(self) -> str:
        """Column names of torque, speed, and efficiency or loss, as a formula."""
        torque, velocity, share = (part.formula for part in self.parts)
        sign = '+' if self.parts[2].quantity == 'loss' else '/'
        return f'{torque} × {velocity} {sign} {share}'

    def convert(self, values: Mapping[str, NDArray[Any]]) -> Floats:
        """Return W [N] from columns [N] by address; NaN where efficiency is outside (0, 1]."""
        torque, velocity, share = (part.convert(values) for part in self.parts)
        shaft = torque * velocity
        if self.parts[2].quantity == 'loss':
            return np.asarray(shaft + share)
        share = np.where((share > 0.0) & (share <= 1.0), share, np.nan)
        return np.asarray(np.where(shaft < 0.0, shaft * share, shaft / share))


@dataclass(frozen=True)
class ImportPlan:
    """Signals that a map takes out of one log."""

    drives: Mapping[str, Mapping[str, LogChannel]]
    supply: Mapping[str, LogChannel]
    torque_at: Mapping[str, str]  # joint or motor, by drive
    torque_unit: Mapping[str, str]  # A where it is a current
    gear_ratio: Mapping[str, float]
    computed: tuple[str, ...]  # drives whose power is marked so
    time: tuple[tuple[LogColumn, str], ...]  # columns that are added, with their units
    stamp: str

    @property
    def derived(self) -> tuple[str, ...]:
        """Drives without a velocity, which is differentiated from their position."""
        return tuple(
            name
            for name, own in self.drives.items()
            if 'velocity' not in own and 'position' in own and own['position'].terms
        )

    def addresses(self) -> tuple[str, ...]:
        """Return the addresses of all columns to be read."""
        parts = [*self.drives.values(), self.supply]
        found = [a for part in parts for channel in part.values() for a in channel.addresses]
        return tuple(dict.fromkeys([*found, *(column.address for column, _ in self.time)]))

    def columns(self) -> dict[str, dict[str, str]]:
        """Return column names of the log by drive and quantity; constants are left out."""
        return {
            drive: {q: channel.formula for q, channel in channels.items() if channel.terms}
            for drive, channels in self.drives.items()
        }


def make_plan(
    mapping: ImportMap, columns: Sequence[LogColumn], where: str, is_bag: bool
) -> ImportPlan:
    """Find the columns that a map names.

    Raises InputError, which begins with `where`, for columns that are not there (with those that
    are spelled alike), units that do not fit, and quantities that cannot stand alone.
    """
    known = {column.address: column for column in columns}
    for column in columns:
        known.setdefault(re.sub(r'\s*[\[(][^\[\]()]*[\])]$', '', column.address), column)
    drives = expand(mapping.drives, tuple(known), where)
    channels: dict[str, dict[str, LogChannel]] = {}
    for name, drive in drives.items():
        signals = drive.signals()
        channels[name] = {
            q: _channel(q, s, known, f'{where}: drives.{name}.{q}', drive.gear_ratio)
            for q, s in signals.items()
            if not s.optional or all(column in known for column in s.columns)
        }
        _with_shaft_power(channels[name], f'{where}: drives.{name}')
        _check_drive(channels[name], f'{where}: drives.{name}')
    supply = {
        q: _channel(q, s, known, f'{where}: supply.{q}')
        for q, s in mapping.supply.signals().items()
    }
    if 'current' in supply and 'voltage' not in supply:
        raise InputError(f'{where}: supply: current without voltage')
    if not supply and not any({'current', 'power'} & set(part) for part in channels.values()):
        raise InputError(
            f'{where}: no current or power of any drive and no supply: nothing to judge a model by'
        )
    time = []
    if not is_bag:
        if mapping.time is None:
            raise InputError(f'{where}: time is missing; give time: {{column: …, unit: s}}')
        for part in mapping.time.parts:
            column = _find(part.source, known, f'{where}: time.column')
            unit = part.unit or _stated(column, 'time') or 's'
            try:
                conversion(unit, 'time')
            except InputError as error:
                raise InputError(f'{where}: time.unit: {error}') from None
            time.append((column, unit))
    torques = {name: drive.torque for name, drive in drives.items() if drive.torque is not None}
    current = [n for n, t in torques.items() if t.scale is None and t.unit in ('A', 'mA')]
    at = {n: t.at or 'joint' for n, t in torques.items()} | dict.fromkeys(current, 'motor')
    gear_ratio = {n: d.gear_ratio for n, d in drives.items() if d.gear_ratio is not None}
    computed = (
        n for n, d in drives.items() if any(s and s.computed for s in (d.power, d.current))
    )
    return ImportPlan(
        channels,
        supply,
        torque_at=at,
        torque_unit=dict.fromkeys(current, 'A'),
        gear_ratio=gear_ratio,
        computed=tuple(computed),
        time=tuple(time),
        stamp=mapping.stamp,
    )


def fitting_maps(source: LogSource) -> list[str]:
    """Return the names of the ready maps all of whose columns a log has."""
    columns, found = source.columns(), []
    for name in names():
        with suppress(InputError):
            make_plan(load_map(name), columns, name, source.is_bag)
            found.append(name)
    return found


def expand(
    drives: Mapping[str, DriveMap], addresses: Sequence[str], where: str
) -> dict[str, DriveMap]:
    """Replace drives whose name has a `*` by those that the log has.

    The star stands for the same text in the name and in each `from`. InputError, which begins with
    `where`, for a `*` that no address matches.
    """
    result: dict[str, DriveMap] = {}
    for name, drive in drives.items():
        if '*' not in name:
            result[name] = drive
            continue
        signals = drive.signals()
        needed = [column for s in signals.values() if not s.optional for column in s.columns]
        patterns = [column for column in needed if '*' in column]
        if not patterns:
            raise InputError(f'{where}: drives.{name}: a * in the name but in no from')
        found = [_matches(pattern, addresses) for pattern in patterns]
        texts = [text for text in found[0] if all(text in other for other in found)]
        if not texts:
            raise InputError(f'{where}: drives.{name}: no column fits {quoted(patterns[0])}')
        for text in texts:
            filled: dict[str, Any] = {q: s.filled(text) for q, s in signals.items()}
            result[name.replace('*', text)] = replace(drive, **filled)
    return result


def _matches(pattern: str, addresses: Sequence[str]) -> list[str]:
    first, *rest = (re.escape(part) for part in pattern.split('*'))
    whole = re.compile(first + r'([^/:.\[\]]+?)' + r'\1'.join(rest))
    short = (a for a in addresses if len(a) <= _LONGEST_MATCHED)
    return list(dict.fromkeys(m[1] for a in short if (m := whole.fullmatch(a))))


def _channel(
    quantity: str,
    signal: Signal,
    known: Mapping[str, LogColumn],
    where: str,
    gear_ratio: float | None = None,
) -> LogChannel:
    if signal.value is not None:
        factor = conversion(signal.unit, quantity) if signal.unit else Conversion()
        return LogChannel(quantity, (), factor, signal.value)
    terms = tuple(tuple(_find(name, known, where) for name in term) for term in signal.terms)
    if len({column.stream for term in terms for column in term}) > 1:
        raise InputError(f'{where}: sum: columns of one topic or table are multiplied only')
    unit = signal.unit
    if not unit and signal.scale is None and not signal.sum:
        unit = _stated(terms[0][0], quantity)
    try:
        convert = _conversion(quantity, signal, unit)
    except InputError as error:
        raise InputError(f'{where}: {error}') from None
    if signal.positive == 'fed':
        convert = Conversion(-convert.factor, -convert.offset)
    if quantity in GEARED and signal.at == 'motor':
        if gear_ratio is None:
            raise InputError(
                f'{where}: at: motor; give gear_ratio, motor turns to one of the joint'
            )
        convert = Conversion(convert.factor / gear_ratio, convert.offset / gear_ratio)
    unit = '' if quantity == 'torque' and unit in ('A', 'mA') else unit
    scale = 1.0 if signal.scale is None else signal.scale
    return LogChannel(quantity, terms, convert, np.nan, signal.positive, unit, scale)


def _conversion(quantity: str, signal: Signal, unit: str) -> Conversion:
    added = signal.offset or 0.0
    of_current = signal.scale is None and quantity == 'torque' and unit in ('A', 'mA')
    base = conversion(unit, 'current' if of_current else quantity) if unit else Conversion()
    if signal.scale is None:
        return Conversion(base.factor, base.offset + added)
    return Conversion(signal.scale * base.factor, base.offset + added * base.factor)


def _stated(column: LogColumn, quantity: str) -> str:
    """The unit that the log itself states, where it fits the quantity."""
    unit = column.unit or unit_of(column.address)
    try:
        conversion(unit, quantity)  # of this one only: others may need what is slow to import
    except InputError:
        return ''
    return unit


def _find(address: str, known: Mapping[str, LogColumn], where: str) -> LogColumn:
    if address in known:
        return known[address]
    short = [name for name in known if len(name) <= _LONGEST][:_MOST_COMPARED]
    near = difflib.get_close_matches(address[:_LONGEST], short, 3, 0.6)
    found = f'is {printable(", ".join(near))}' if near else f'are {len(known)}: see --list'
    raise InputError(f'{where}: no column {quoted(address)}; there {found}')


def _with_shaft_power(channels: dict[str, LogChannel], where: str) -> None:
    """Put a power in the place of an efficiency or a loss."""
    given = [q for q in ('efficiency', 'loss', 'power', 'current') if q in channels]
    if not {'efficiency', 'loss'} & set(given):
        return
    if len(given) > 1:
        raise InputError(f'{where}: give one of {", ".join(given)}')
    share = channels.pop(given[0])
    torque, velocity = (channels.get(quantity) for quantity in ('torque', 'velocity'))
    if torque is None or velocity is None or not torque.terms or not velocity.terms:
        raise InputError(
            f'{where}: {given[0]} without torque and velocity, whose product it is of'
        )
    if len({channel.stream for channel in (torque, velocity, share)}) > 1:
        raise InputError(
            f'{where}: {given[0]}, torque and velocity are of one table or topic only'
        )
    parts = (torque, velocity, share)
    channels['power'] = ShaftPower('power', torque.terms, Conversion(), parts=parts)


def _check_drive(channels: Mapping[str, LogChannel], where: str) -> None:
    moving = {'position', 'velocity'} & set(channels)
    if not moving and 'torque' not in channels:
        raise InputError(f'{where}: neither position, velocity nor torque')
    for given, about in (
        ('current', ''),
        ('power', ', the nominal one: names and watts hardly depend on it'),
    ):
        if given in channels and 'voltage' not in channels:
            raise InputError(
                f'{where}: {given} without voltage; add voltage: {{from: …}} or '
                f'{{value: VOLTS, unit: V}}{about}'
            )
    if {'power', 'current'} <= set(channels):
        raise InputError(f'{where}: give current or power, not both')
    if not any(channel.terms for channel in channels.values()):
        raise InputError(f'{where}: only constants')
