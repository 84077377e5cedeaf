"""Stamps of a log's rows: units, dates, restarts, repeated and backward times."""

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime, time, timedelta, timezone
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.arrays import Floats, Stamps
from wattwalk_core.errors import InputError, quoted

from power_recordings.importing.units import conversion

DAY: Final = 86_400 * 10**9  # ns
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
_DATE: Final = r'(?P<first>\d{1,4})[-./:](?P<second>\d{1,2})[-./:](?P<third>\d{1,4})'
_CLOCK: Final = (
    r'(?P<hour>\d{1,2}):(?P<minute>\d\d)(:(?P<seconds>\d\d)([.,:](?P<rest>\d{1,9}))?)?'
    r'\s*(?P<half>[AaPp])?\.?(?(half)[Mm]\.?)'
)
MISSING: Final = int(np.iinfo(np.int64).min)
_ZONE: Final = r'\s*(?P<zone>Z|UTC|GMT|[+-]\d\d:?\d\d)?'
_BOTH: Final = re.compile(rf'{_DATE}[T_, ]+{_CLOCK}{_ZONE}')
_ALONE: Final = re.compile(rf'{_CLOCK}')
_DATE_ALONE: Final = re.compile(_DATE)


def is_time_of_day(text: str) -> bool:
    """Return whether a text is a time without a date."""
    return bool(_ALONE.fullmatch(text.strip()))


def is_date(text: str) -> bool:
    """Return whether a text is a date without a time."""
    return bool(_DATE_ALONE.fullmatch(text.strip())) and not is_time_of_day(text)


def moments(texts: NDArray[Any], where: str, *, strict: bool = True) -> Stamps:
    """Parse texts [N] to ns since 1970, or since midnight without a date; −1 for empty ones.

    In dates with the year last, the month comes first if any text has AM or PM or a second number
    above 12. InputError, which begins with `where`, for a text that is no time; if not strict,
    MISSING of this and of an empty one.
    """
    given = ['' if text is None else str(text).strip() for text in texts.tolist()]
    month_first = any(map(_is_month_first, given))
    missing = -1 if strict else MISSING
    stamps = np.full(len(given), missing, np.int64)
    for row, text in enumerate(given):
        try:
            stamps[row] = _moment(text, month_first) if text else missing
        except (ValueError, OverflowError):
            if strict:
                raise InputError(
                    f'{where}: {quoted(text)} is no time; expected numbers, dates such as '
                    '2026-11-22T10:00:00.000, or times of day'
                ) from None
    return stamps


def unwrapped(times: Stamps, last: int) -> Stamps:
    """Add passed days to times of day [N] in ns (−1: missing) that follow `last` (−1 if none)."""
    known = np.flatnonzero(times >= 0)
    own = times[known]
    before = np.concatenate([[last % DAY if last >= 0 else own[0] if len(own) else 0], own[:-1]])
    days = np.cumsum(own - before < -DAY // 2) + (last // DAY if last >= 0 else 0)
    result = times.copy()
    result[known] = own + days * DAY
    return result


def _is_month_first(text: str) -> bool:
    found = _BOTH.fullmatch(text) or _DATE_ALONE.fullmatch(text)
    if found is None or len(found['first']) > 2:
        return False
    return int(found['second']) > 12 or bool(found.groupdict().get('half'))


def _moment(text: str, month_first: bool) -> int:
    with suppress(ValueError):
        return _ns(datetime.fromisoformat(text))
    found = _BOTH.fullmatch(text) or _ALONE.fullmatch(text) or _DATE_ALONE.fullmatch(text)
    if found is None:
        raise ValueError
    return _of_parts(found.groupdict(), month_first)


def _ns(moment: datetime) -> int:
    span = (moment if moment.tzinfo else moment.replace(tzinfo=UTC)) - _EPOCH
    return span // timedelta(microseconds=1) * 1000


def _of_parts(parts: dict[str, str | None], month_first: bool) -> int:
    hour = int(parts.get('hour') or 0)
    if half := parts.get('half'):
        hour = hour % 12 + (12 if half in 'Pp' else 0)
    clock = time(hour, int(parts.get('minute') or 0), int(parts.get('seconds') or 0))
    rest = int((parts.get('rest') or '').ljust(9, '0') or 0)
    of_day = ((hour * 60 + clock.minute) * 60 + clock.second) * 10**9 + rest
    if not parts.get('first'):
        return of_day
    first, second, third = parts['first'] or '', parts['second'] or '', parts['third'] or ''
    if len(first) == 4:
        year, month, day = int(first), int(second), int(third)
    else:
        year = int(third) + (2000 if len(third) <= 2 else 0)
        day, month = (int(second), int(first)) if month_first else (int(first), int(second))
    return _ns(datetime(year, month, day, tzinfo=_zone(parts.get('zone')))) + of_day


def _zone(text: str | None) -> timezone:  # of each row: strptime takes four times as long
    if not text or text[0] not in '+-':
        return UTC
    size = timedelta(hours=int(text[1:3]), minutes=int(text[-2:]))
    return timezone(size if text[0] == '+' else -size)


START = 1_000_000_000  # s, of logs whose times are relative
_SINCE_1970 = 1e8  # s; larger times are taken for seconds since 1970
PAUSE = 1_000_000_000  # ns between parts of a log that follow on each other
_MOST_BAD = 0.5  # share of rows whose time is of no use
_MOST_BACK = 0.1  # share of rows that are older than the row before
_LEAST_KEPT = 25.0  # Hz, of rows with a time of their own
_DISORDER = 500_000_000  # ns that rows may be out of order by
_LATEST = 4e9  # s
_RATES = (0.2, 5e4)  # Hz, that a log of a drive can have
_UNITS = ('s', 'ms', 'us', 'ns')


@dataclass(frozen=True)
class TimedRows:
    """Rows of a block that are kept, in the order of time.

    rows [K] of the block, of which those from each of `starts` [N] to the next share stamps [N].
    """

    rows: NDArray[np.intp]
    starts: NDArray[np.intp]
    stamps: Stamps  # ns

    def of(self, values: NDArray[Any]) -> NDArray[Any]:
        """Reduce a block's column to the kept rows [N]; rows of a common stamp are averaged."""
        kept = values if len(self.rows) == len(values) else values[self.rows]
        if len(self.starts) == len(self.rows):
            return kept
        if kept.dtype.kind == 'O':
            return kept[self.starts]
        known = np.isfinite(kept)
        sums = np.add.reduceat(np.where(known, kept, 0.0), self.starts)
        with np.errstate(invalid='ignore'):
            return np.asarray(sums / np.add.reduceat(known.astype(np.float64), self.starts))


_NONE = np.zeros(0, np.intp)


@dataclass
class LogClock:
    """Turns the times of one log into ascending stamps, block by block.

    Rows with the time of the row before are merged with it. A time that goes back by more than
    half a second starts a new part, 1 s after the last; other rows older than one before, and rows
    without a time, are left out. where: begins errors. units: of the time columns, which are
    added. shift: ns, added to all times. parts to late: counts of parts and rows so far.
    """

    where: str
    units: tuple[str, ...] = ('s',)
    shift: int = 0
    last: int | None = None  # ns, of the last row that was kept
    parts: int = 0
    rows: int = 0
    repeated: int = 0
    missing: int = 0
    late: int = 0
    _before: int | None = None
    _span: int = 0  # ns, of all parts
    _of_day: int = -1  # ns, of the last time of day

    def order(self, raw: Stamps) -> TimedRows:
        """Return a block's rows to keep, with their stamps; raw: ns [N], negative: missing."""
        self.rows += len(raw)
        rows = np.flatnonzero(raw >= 0)
        self.missing += len(raw) - len(rows)
        raw = raw[rows]
        if not len(raw):
            return TimedRows(_NONE, _NONE, raw)
        begins = np.diff(raw, prepend=self._before if self._before is not None else 0) < -_DISORDER
        if self._before is None:
            begins[0] = True
        keep, fresh = np.zeros((2, len(raw)), np.bool_)
        stamps = np.empty_like(raw)
        edges = np.union1d(np.flatnonzero(begins), [0, len(raw)]).astype(int).tolist()
        for start, stop in pairwise(edges):
            part = raw[start:stop]
            if begins[start]:
                self.parts += 1
                if self.last is not None:
                    self.shift = max(self.shift, self.last + PAUSE - int(part[0]))
                latest = int(part[0]) - 1
            else:
                assert self._before is not None
                latest = self._before
            newest = np.maximum.accumulate(part)
            before = np.maximum(np.concatenate([[latest], newest[:-1]]), latest)
            fresh[start:stop] = part > before
            # A row goes to the mean of its time only where that was begun in this block.
            begun = np.maximum.accumulate(fresh[start:stop])
            keep[start:stop] = (part >= before) & begun
            self.late += int((part < before).sum())
            self.repeated += int((part == before).sum())
            stamps[start:stop] = part + self.shift
            self._before = max(int(newest[-1]), latest)
            self._span += self._before - (int(part[0]) if begins[start] else latest)
            self.last = self._before + self.shift
        return TimedRows(rows[keep], np.flatnonzero(fresh[keep]), stamps[fresh])

    def check(self) -> None:
        """Raise InputError if too many rows so far have missing, repeated or backward times."""
        if not self.rows or self.rows == self.missing:
            raise InputError(f'{self.where}: no row with a time')
        if self.missing > _MOST_BAD * self.rows:
            raise InputError(f'{self.where}: {self.missing} of {self.rows} rows have no time')
        back = self.late + max(self.parts - 1, 0)
        if self.late + 5 * max(self.parts - 1, 0) > _MOST_BACK * self.rows:
            raise InputError(f'{self.where}: time goes back in {back} of {self.rows} rows')
        seconds = max(self._span, 1) / 1e9
        if self.repeated > _MOST_BAD * self.rows:
            kept = (self.rows - self.repeated) / seconds
            if not self._span or kept < _LEAST_KEPT:
                rate = '' if not self._span else f': time: {{rate: {self.rows / seconds:.4g}}}'
                raise InputError(
                    f'{self.where}: {self.repeated} of {self.rows} rows repeat the time of the '
                    f'row before; give the rate of the rows in its place{rate}'
                )

    def notes(self) -> list[str]:
        """Return sentences on the rows that were left out or merged."""
        back = max(self.parts - 1, 0)
        counts = {
            f'{self.missing} rows without a time left out': self.missing,
            f'{self.repeated} rows with the time of the row before merged with it (mean)': (
                self.repeated
            ),
            f'{self.late} rows older than the row before left out': self.late,
            f'{self.parts} parts: time goes back in {back} places': back,
        }
        return [text for text, count in counts.items() if count]

    def nanoseconds(self, columns: Sequence[NDArray[Any]]) -> Stamps:
        """Return the sum of time columns [N], numbers or dates, in ns; −1 if one is missing."""
        first, *others = columns
        if others or first.dtype.kind == 'O':
            return self._added(columns)
        unit, times = self.units[0], first
        seconds = times * conversion(unit, 'time').factor
        finite = np.isfinite(seconds)
        late = finite & (np.abs(seconds) > _LATEST)
        if late.sum() > 0.5 * finite.sum():
            largest = float(np.abs(times[finite]).max())
            raise InputError(
                f'{self.where}: times reach {largest:.4g} {unit}; is that their unit? '
                'expected s, ms, us or ns'
            )
        bad = ~finite | late
        if not self.rows:
            self._check_unit(seconds[~bad])
        whole = np.where(bad, 0.0, seconds)
        relative = len(whole) and float(np.median(whole)) < _SINCE_1970
        result = np.rint(whole * 1e9).astype(np.int64) + (START * 10**9 if relative else 0)
        return np.where(bad, -1, result)

    def _added(self, columns: Sequence[NDArray[Any]]) -> Stamps:
        """Return the sum of columns: numbers, dates, times of day.

        Each column is rounded to ns by itself: float64 holds no ns of seconds since 1970. Times of
        day without a date go on over midnight.
        """
        total, known = np.zeros(len(columns[0]), np.int64), np.ones(len(columns[0]), np.bool_)
        of_day = dated = False
        for unit, times in zip(self.units, columns, strict=True):
            if times.dtype.kind == 'O':
                part = moments(times, self.where)
                good = part >= 0
                of_day |= bool(good.any()) and int(part[good].max()) < DAY
                dated |= bool(good.any()) and int(part[good].max()) >= DAY
            else:
                seconds = times * conversion(unit, 'time').factor
                good = np.isfinite(seconds) & (np.abs(seconds) < _LATEST)
                whole = np.where(good, np.trunc(seconds), 0.0)
                rest = np.where(good, seconds - whole, 0.0)
                part = whole.astype(np.int64) * 10**9 + np.rint(rest * 1e9).astype(np.int64)
            known &= good
            total += np.where(good, part, 0)
        if not known.any():
            return np.full(len(total), -1, np.int64)
        if of_day and not dated:
            total = unwrapped(np.where(known, total, -1), self._of_day)
            self._of_day = int(total.max())
        if float(np.median(total[known])) < _SINCE_1970 * 1e9:
            total += START * 10**9
        return np.where(known, total, -1)

    def _check_unit(self, seconds: Floats) -> None:
        """InputError where another unit of time would make a likely rate, and this does not."""
        steps = np.diff(seconds)
        steps = steps[steps > 0]
        if len(steps) < 2:
            return
        rate = 1 / float(np.median(steps))
        if _RATES[0] <= rate <= _RATES[1]:
            return
        unit = conversion(self.units[0], 'time').factor
        for other in _UNITS:
            likely = rate * unit / conversion(other, 'time').factor
            if 5 <= likely <= 2e4:
                raise InputError(
                    f'{self.where}: times in {self.units[0]} make {rate:.3g} rows a second; is '
                    f'that their unit? {other} would make {likely:.3g}: time: {{unit: {other}}}'
                )
