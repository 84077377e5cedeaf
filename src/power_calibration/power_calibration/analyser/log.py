"""The log of a power analyser: its columns, units and time stamps, checked."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from power_recordings.importing.sources.delimited import DelimitedFile
from power_recordings.importing.sources.source import Progress, number
from power_recordings.importing.times import MISSING, moments
from scipy.ndimage import binary_opening
from wattwalk_core.arrays import Bools, Floats
from wattwalk_core.errors import InputError, quoted
from wattwalk_core.files import advice

from power_calibration.analyser.curve import Curve

QUANTITIES = ('voltage', 'current', 'power')
_KEYS = ('time', *QUANTITIES)
_FEWEST = 100  # rows
_GAP = 0.5  # periods beyond one, where stamps are even
_WIDEST_GAP = 1.5  # the same, however uneven they are
_SHARED = 0.25  # of the rows have the stamp of the row before
_CLIPPED = 0.002  # share of the rows at which the log is refused
_ALIASES: Mapping[str, tuple[str, ...]] = {
    'time': ('time', 'timestamp', 'date', 'datetime', 'zeit', 't', 'x'),
    'voltage': ('voltage', 'volt', 'volts', 'spannung', 'vdc', 'udc', 'urms', 'vrms', 'u', 'v'),
    'current': ('current', 'amp', 'amps', 'strom', 'idc', 'irms', 'i', 'a'),
    'power': ('power', 'watt', 'watts', 'leistung', 'pdc', 'p', 'w'),
}
_SCALES: Mapping[str, Mapping[str, float]] = {
    'time': {'s': 1.0, 'ms': 1e-3, 'us': 1e-6, 'µs': 1e-6, 'ns': 1e-9, 'min': 60.0, 'h': 3600.0},
    'voltage': {'v': 1.0, 'mv': 1e-3, 'kv': 1e3},
    'current': {'a': 1.0, 'ma': 1e-3, 'ka': 1e3},
    'power': {'w': 1.0, 'mw': 1e-3, 'kw': 1e3},
}
_UNITS = {unit for scales in _SCALES.values() for unit in scales}
_EPOCHS = ((1e17, 1e-9), (1e14, 1e-6), (1e11, 1e-3))
_DATE = re.compile(r'(\d{4}-\d\d-\d\d|\d\d\.\d\d\.\d{4})[T ]\d\d:\d\d')
_DOTTED = re.compile(r'^(\d\d)\.(\d\d)\.(\d{4})')
_CLOCK = re.compile(r'\d{1,2}:\d\d:\d\d')


@dataclass(frozen=True)
class Log:
    """N rows of an analyser with ascending stamps, in runs without gaps or rows left out.

    voltage (V), current (A), power (W): [N] or None where the file has no such column.
    """

    path: Path
    time: Floats  # s [N], of the analyser's clock, less `start`
    start: float  # s, the first stamp as the file has it
    period: float  # s between rows
    starts: NDArray[np.intp]  # first row of each run
    stops: NDArray[np.intp]  # one after its last
    voltage: Floats | None
    current: Floats | None
    power: Floats | None
    notes: tuple[str, ...] = ()

    @property
    def rate(self) -> float:
        """Rows per second."""
        return 1.0 / self.period

    @property
    def duration(self) -> float:
        """First to last row, s."""
        return float(self.time[-1] - self.time[0])

    @property
    def watts(self) -> Floats | None:
        """Power of each row, W [N]: as logged, else voltage × current; None without both."""
        if self.power is not None:
            return self.power
        if self.voltage is not None and self.current is not None:
            return self.voltage * self.current
        return None

    def curve(self, values: Floats) -> Curve:
        """Return values of the N rows, [N] or [N, K], as a curve with the log's times."""
        columns = values.reshape(len(values), -1)
        return Curve.of(self.time, columns, self.starts, self.stops, self.period)

    @classmethod
    def read(cls, path: Path, columns: str = '', progress: Progress = lambda size: None) -> 'Log':
        """Read a CSV file; columns: `time=NAME,voltage=NAME[*scale],…`, sniffed if empty.

        A name is that of the header or a column's number from 1. Raises InputError for a file
        that cannot be read or understood, has under 100 rows of use, is constant or clipped.
        """
        try:
            file = DelimitedFile(path)
            heads = file.dialect.head.names
            places, scales = _columns(path, heads, columns)
            names = [key for key in _KEYS if key in places]
            rows, notes = _read_columns(file, [heads[places[key]] for key in names], progress)
        except OSError as error:
            raise InputError(f'cannot read {path}: {advice(error)}') from error
        for column, key in enumerate(names):
            rows[:, column] *= scales[key]
        if scales['time'] == 1.0:
            # Stamps since 1970 tell their unit by their size.
            middle = float(np.nanmedian(rows[:, 0])) if np.isfinite(rows[:, 0]).any() else 0.0
            rows[:, 0] *= next((scale for least, scale in _EPOCHS if abs(middle) > least), 1.0)
        return cls.of(path, names, rows, notes)

    @classmethod
    def of(cls, path: Path, names: Sequence[str], rows: Floats, told: Sequence[str] = ()) -> 'Log':
        """Make a log of rows [N, K]: time and the named quantities, in s, V, A and W.

        told: notes of the reader, kept in `notes`. InputError as of `read`.
        """
        notes = list(told)
        whole = np.isfinite(rows).all(axis=1)
        if lost := int((~whole).sum()):
            notes.append(f'{lost} of {len(rows)} rows have a field that is no number; left out')
        number = np.flatnonzero(whole)
        rows = rows[whole]
        back = rows[:, 0] < np.maximum.accumulate(rows[:, 0])
        if back.any():
            notes.append(f'{int(back.sum())} rows whose time runs backwards left out')
            rows, number = rows[~back], number[~back]
        if len(rows) < _FEWEST:
            raise InputError(
                f'{path} has {len(rows)} rows of use; at least {_FEWEST} are needed'
                + ''.join(f'; {note}' for note in notes)
            )
        time, period, starts, stops = _regular(path, rows[:, 0] - rows[0, 0], np.diff(number) > 1)
        values = {key: rows[:, column].copy() for column, key in enumerate(names) if key != 'time'}
        notes += _clipping(path, values)
        volts, amps, watts = (values.get(key) for key in QUANTITIES)
        begin = float(rows[0, 0])
        return cls(path, time, begin, period, starts, stops, volts, amps, watts, tuple(notes))


def _read_columns(
    file: DelimitedFile, names: Sequence[str], progress: Progress
) -> tuple[Floats, tuple[str, ...]]:
    """Return the named columns, time first, [N, K], and notes on what was left out.

    Fields that are no numbers are NaN. Dates are s since 1970 in UTC (without a zone as if they
    were UTC), times of day s since midnight. InputError for a time in another form.
    """
    blocks = list(file.read(names, progress))
    columns = [
        np.concatenate([_numbers(block.values[name], file.path, is_time) for block in blocks])
        for name, is_time in zip(names, (True, *(False for _ in names[1:])), strict=True)
    ]
    rows = np.column_stack(columns)
    if any(_CLOCK.match(_sample(block.values[names[0]])) for block in blocks):
        rows[1:, 0] += 86_400 * np.cumsum(np.diff(rows[:, 0]) < -43_200)
    return rows, tuple(note for block in blocks for note in block.notes)


def _numbers(values: NDArray[np.generic], path: Path, is_time: bool) -> Floats:
    if values.dtype.kind != 'O' or not is_time:
        return number(values)
    sample = _sample(values)
    if _DATE.match(sample):
        # The day comes first, also beside a damaged date whose second number is above 12.
        texts = [_DOTTED.sub(r'\3-\2-\1', text or '') for text in values.tolist()]
        stamps = moments(np.array(texts, object), str(path), strict=False)
        return np.where(stamps > MISSING, stamps / 1e9, np.nan)
    if _CLOCK.match(sample):
        return _clocks(values.tolist())
    raise InputError(
        f'{path}: time {quoted(sample)} is not understood; expected seconds, ISO 8601 such as '
        '2025-06-15T14:00:00.000, DD.MM.YYYY HH:MM:SS or HH:MM:SS'
    )


def _sample(values: NDArray[np.generic]) -> str:
    """First text of a column, '' for one of numbers."""
    return next((text for text in values if text), '') if values.dtype.kind == 'O' else ''


def _clocks(texts: Sequence[str | None]) -> Floats:
    seconds = np.full(len(texts), np.nan)
    for row, text in enumerate(texts):
        try:
            hours, minutes, rest = (text or '').replace(',', '.').split(':')
            seconds[row] = 3600 * int(hours) + 60 * int(minutes) + float(rest)
        except ValueError:
            continue
    return seconds


def _columns(
    path: Path, names: Sequence[str], given: str
) -> tuple[dict[str, int], dict[str, float]]:
    """Return the column of each quantity, and the factor to SI units."""
    bare, units = zip(*map(_head, names), strict=True)
    places: dict[str, int] = {}
    scales: dict[str, float] = {}

    def unit_scale(key: str) -> float:
        return _SCALES[key].get(units[places[key]], 1.0)

    if given:
        for part in given.split(','):
            key, equals, value = part.strip().partition('=')
            if not equals or key not in _KEYS:
                raise InputError(
                    f'--columns {part!r}: expected time=NAME, voltage=NAME, current=NAME or '
                    'power=NAME, each with *scale if need be'
                )
            name, _, factor = value.partition('*')
            places[key] = _place(path, names, bare, name.strip())
            scales[key] = _factor(part, factor) if factor else unit_scale(key)
        if 'time' not in places:
            raise InputError(f'--columns {given!r}: time is missing')
    else:
        for key, aliases in _ALIASES.items():
            alias = next((alias for alias in aliases if alias in bare), None)
            if alias is not None:
                places[key] = bare.index(alias)
                scales[key] = unit_scale(key)
    if 'time' not in places or len(places) < 2:
        raise InputError(
            f'{path}: which columns hold what? There are {", ".join(map(repr, names))}; say '
            '--columns time=NAME,voltage=NAME,current=NAME (or their numbers from 1)'
        )
    return places, scales


def _head(text: str) -> tuple[str, str]:
    """Return name and unit of a column's head in small letters: `U [mV]` and `u_mV` are u, mv."""
    text = text.strip().lower().replace('μ', 'µ')
    bracket = re.search(r'[\[(/]\s*([^\])]*)[\])]?$', text)
    name, _, unit = text.rpartition('_')
    if bracket:
        name, unit = text[: bracket.start()], bracket[1].strip()
    elif unit not in _UNITS:
        name, unit = text, ''
    return re.sub(r'[^a-zäöüµ]', '', name), unit


def _factor(part: str, factor: str) -> float:
    try:
        value = float(factor)
    except ValueError:
        value = 0.0
    if not value or not np.isfinite(value):
        raise InputError(f'--columns {part!r}: {factor!r} is no scale; such as *0.001 or *-1')
    return value


def _place(path: Path, names: Sequence[str], bare: Sequence[str], name: str) -> int:
    if name in names:
        return names.index(name)
    if name.isdigit() and 1 <= int(name) <= len(names):
        return int(name) - 1
    if name.lower() in bare:
        return bare.index(name.lower())
    raise InputError(
        f'--columns: {path} has no column {name!r}; there are {", ".join(names)}, or numbers '
        f'from 1 to {len(names)}'
    )


def _regular(
    path: Path, time: Floats, left_out: Bools
) -> tuple[Floats, float, NDArray[np.intp], NDArray[np.intp]]:
    """Stamps without the rounding of their print, the period, and the runs between gaps.

    left_out: rows were left out after the row [N − 1]; a run ends there, as at any step that
    neither rounding nor jitter explains. A log of 20 kHz is often printed in ms: stamps are laid
    on an even clock if none moves by more than half the step of print (and what a line through so
    few is uncertain by); else rows that share a stamp are spread within it, and others stay.
    """
    steps = np.diff(time)
    if not steps.size or time[-1] <= 0:
        raise InputError(f'{path}: all rows have the same time {time[0]:g}')
    stride = max(1, min(len(steps) // 8, 1 + int(10 * (steps == 0).sum() / (steps > 0).sum())))
    period = float(np.median(time[stride:] - time[:-stride])) / stride
    if period <= 0:
        raise InputError(f'{path}: most rows have the same time; is it the right column?')
    rounding = _print_step(time)
    longer = min(len(steps) // 8, int(np.ceil(20.0 * rounding / period)))
    if longer > stride:
        period = float(np.median(time[longer:] - time[:-longer])) / longer
    unit = period
    if np.mean(steps == 0) > _SHARED:
        unit = max(period, float(np.median(steps[steps > 0])))
        rounding = max(rounding, unit)
    uneven = max(0.0, float(np.median(np.abs(steps[steps > 0] - unit))) - rounding)
    beyond = max(_GAP * unit, rounding * (1.0 - 1e-6), min(6.0 * uneven, _WIDEST_GAP * unit))
    cuts = np.flatnonzero((steps > unit + beyond) | left_out) + 1
    starts = np.concatenate([[0], cuts]).astype(np.intp)
    stops = np.concatenate([cuts, [len(time)]]).astype(np.intp)
    smooth = time.copy()
    slopes: list[tuple[int, float]] = []
    for start, stop in zip(starts.tolist(), stops.tolist(), strict=True):
        count = stop - start
        if count < 3:
            continue
        index = np.arange(count, dtype=np.float64)
        slope, origin = np.polyfit(index, time[start:stop], 1)
        even = origin + slope * index
        most = rounding * (0.5 + 1.0 / np.sqrt(count))
        if slope > 0 and np.abs(even - time[start:stop]).max() <= most:
            smooth[start:stop] = even
            slopes.append((count, float(slope)))
        elif (np.diff(time[start:stop]) <= 0).any():
            smooth[start:stop] = _spread(time[start:stop], period)
    return smooth, max(slopes)[1] if slopes else period, starts, stops


def _print_step(time: Floats) -> float:
    """The power of ten in s that all stamps are multiples of, 0 if they are finer than 1 µs."""
    for digits in range(7):
        parts = time * 10.0**digits
        if np.abs(parts - np.rint(parts)).max() < 0.1:
            return float(10.0**-digits)
    return 0.0


def _spread(time: Floats, period: float) -> Floats:
    """Rows that share a stamp, moved apart within the time to the next one."""
    first = np.flatnonzero(np.concatenate([[True], np.diff(time) > 0]))
    index = np.arange(len(time), dtype=np.float64)
    anchors = np.append(first, len(time))
    stamps = np.append(time[first], time[-1] + period * (len(time) - first[-1]))
    spread: Floats = np.interp(index, anchors, stamps)
    return spread


def _clipping(path: Path, logged: Mapping[str, Floats]) -> list[str]:
    """Refuse what is constant or clipped; return notes on a little clipping."""
    notes = []
    for key in QUANTITIES:
        if key not in logged:
            continue
        values = logged[key]
        if values.max() - values.min() <= 1e-6 * max(1.0, abs(float(values[0]))):
            if key == 'voltage' and len(logged) > 1:
                notes.append(f'voltage is constant ({values[0]:g} V)')
                continue
            raise InputError(
                f'{path}: {key} is constant ({values[0]:g}) in all {len(values)} rows; '
                'was the drive moving, and is it the right column?'
            )
        for limit in (values.max(), values.min()):
            share = _clipped(values, float(limit))
            if share > _CLIPPED:
                raise InputError(
                    f'{path}: {key} saturates at {limit:g} in {share:.1%} of the rows; '
                    'choose a larger range of the analyser'
                )
            if share:
                notes.append(f'{key} saturates at {limit:g} in {share:.2%} of the rows')
    return notes


def _clipped(values: Floats, limit: float) -> float:
    """Share of rows in stretches of five and more at a limit, if it is far fuller than below."""
    there = values == limit
    if there.sum() < 10:
        return 0.0
    long = int(binary_opening(there, np.ones(5)).sum())
    if not long:
        return 0.0
    others = np.unique(values[~there])
    nearest = others[np.argmin(np.abs(others - limit))]
    crowd = int((values == nearest).sum())
    return long / len(values) if there.sum() > 5 * crowd else 0.0
