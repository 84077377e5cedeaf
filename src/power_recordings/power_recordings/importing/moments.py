"""Dates and times of day as people and instruments write them, in ns."""

import re
from contextlib import suppress
from datetime import UTC, datetime, timedelta, timezone
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.arrays import Stamps
from wattwalk_core.errors import InputError, quoted

DAY: Final = 86_400 * 10**9  # ns
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
_DATE: Final = r'(?P<first>\d{1,4})[-./:](?P<second>\d{1,2})[-./:](?P<third>\d{1,4})'
_CLOCK: Final = (
    r'(?P<hour>\d{1,2}):(?P<minute>\d\d)(:(?P<seconds>\d\d)([.,:](?P<rest>\d{1,9}))?)?'
    r'\s*(?P<half>[AaPp])?\.?(?(half)[Mm]\.?)'
)
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


def moments(texts: NDArray[Any], where: str) -> Stamps:
    """Return texts [N] in ns since 1970, or since midnight without a date; -1 for empty ones.

    Of dates with the year last the month comes first where a text has AM or PM or the second
    number is no month. InputError, which begins with `where`, for a text that is no time.
    """
    given = ['' if text is None else str(text).strip() for text in texts.tolist()]
    month_first = any(map(_is_month_first, given))
    return np.array(
        [_moment(text, month_first, where) if text else -1 for text in given], np.int64
    )


def unwrapped(times: Stamps, last: int) -> Stamps:
    """Add the days to times of day [N] (-1: missing) that pass after `last` (ns, -1 if none)."""
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


def _moment(text: str, month_first: bool, where: str) -> int:
    with suppress(ValueError):
        moment = datetime.fromisoformat(text)
        return _ns(moment if moment.tzinfo else moment.replace(tzinfo=UTC))
    found = _BOTH.fullmatch(text) or _ALONE.fullmatch(text) or _DATE_ALONE.fullmatch(text)
    try:
        if found is None:
            raise ValueError
        return _of_parts(found.groupdict(), month_first)
    except (ValueError, OverflowError):
        raise InputError(
            f'{where}: {quoted(text)} is no time; expected numbers, dates such as '
            '2026-11-22T10:00:00.000, or times of day'
        ) from None


def _ns(moment: datetime) -> int:
    span = moment - _EPOCH
    return (span.days * 86_400 + span.seconds) * 10**9 + span.microseconds * 1000


def _of_parts(parts: dict[str, str | None], month_first: bool) -> int:
    hour = int(parts.get('hour') or 0)
    if half := parts.get('half'):
        hour = hour % 12 + (12 if half in 'Pp' else 0)
    clock = [hour, int(parts.get('minute') or 0), int(parts.get('seconds') or 0)]
    if hour > 23 or max(clock[1:]) > 59:
        raise ValueError
    rest = int((parts.get('rest') or '').ljust(9, '0') or 0)
    of_day = ((clock[0] * 60 + clock[1]) * 60 + clock[2]) * 10**9 + rest
    if not parts.get('first'):
        return of_day
    first, second, third = parts['first'] or '', parts['second'] or '', parts['third'] or ''
    if len(first) == 4:
        year, month, day = int(first), int(second), int(third)
    else:
        year = int(third) + (2000 if len(third) <= 2 else 0)
        day, month = (int(second), int(first)) if month_first else (int(first), int(second))
    return _ns(datetime(year, month, day, tzinfo=_zone(parts.get('zone')))) + of_day


def _zone(text: str | None) -> timezone:
    if not text or text[0] not in '+-':
        return UTC
    size = timedelta(hours=int(text[1:3]), minutes=int(text[-2:]))
    return timezone(size if text[0] == '+' else -size)
