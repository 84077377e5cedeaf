"""Stamps of a log's rows: units, dates, restarts, repeated and backward times."""

import re
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.errors import InputError
from wattwalk_core.quoting import quoted

from power_recordings.importing.units import conversion

Stamps = NDArray[np.int64]

START = 1_000_000_000  # s, of logs whose times are relative
_EPOCH = 1e8  # s; larger times are taken for seconds since 1970
PAUSE = 1_000_000_000  # ns between parts of a log that follow on each other
_MOST_BAD = 0.1  # share of rows whose time is of no use
_LATEST = 4e9  # s
_RATES = (0.2, 5e4)  # Hz, that a log of a drive can have
_UNITS = ('s', 'ms', 'us', 'ns')
_ORDINARY = re.compile(r'(\d{4})[:/.](\d\d)[:/.](\d\d)[ T:](\d\d:\d\d:.*)')


@dataclass
class LogClock:
    """
    Turns the times of one log into ascending stamps, block by block.

    A time that goes back starts a new part, which follows 1 s after the last. Rows without a time,
    or with that of the row before, are left out. `check` raises InputError where that is more than
    a tenth of them. shift [ns] is added to all times.
    """

    where: str
    unit: str = 's'
    shift: int = 0
    last: int | None = None  # ns, of the last row that was kept
    parts: int = 0
    rows: int = 0
    repeated: int = 0
    missing: int = 0
    _before: int | None = None

    def order(self, raw: Stamps) -> tuple[NDArray[np.intp], Stamps]:
        """Return the rows to keep and their stamps, of times in ns (negative: missing)."""
        self.rows += len(raw)
        keep = np.flatnonzero(raw >= 0)
        self.missing += len(raw) - len(keep)
        raw = raw[keep]
        if not len(raw):
            return keep, raw
        steps = np.diff(raw, prepend=self._before if self._before is not None else raw[:1] - 1)
        fresh = steps != 0
        self.repeated += int((~fresh).sum())
        keep, raw, steps = keep[fresh], raw[fresh], steps[fresh]
        if not len(raw):
            return keep, raw
        begins = steps < 0
        if self._before is None:
            begins[0] = True
        self._before = int(raw[-1])
        stamps = np.empty_like(raw)
        edges = np.union1d(np.flatnonzero(begins), [0, len(raw)]).astype(int).tolist()
        for start, stop in pairwise(edges):
            if begins[start]:
                self.parts += 1
                if self.last is not None:
                    self.shift = max(self.shift, self.last + PAUSE - int(raw[start]))
            stamps[start:stop] = raw[start:stop] + self.shift
            self.last = int(stamps[stop - 1])
        return keep, stamps

    def check(self) -> None:
        """InputError where the times of a log are of no use."""
        if not self.rows or self.rows == self.missing:
            raise InputError(f'{self.where}: no row with a time')
        for count, what in (
            (self.missing, 'have no time'),
            (self.repeated, 'repeat the time of the row before'),
            (max(self.parts - 1, 0) * 5, ''),
        ):
            if count > _MOST_BAD * self.rows:
                if what:
                    raise InputError(f'{self.where}: {count} of {self.rows} rows {what}')
                raise InputError(
                    f'{self.where}: time goes back in {self.parts - 1} of {self.rows} rows'
                )

    def notes(self) -> list[str]:
        """Describe what was left out."""
        found = []
        if self.missing:
            found.append(f'{self.missing} rows without a time left out')
        if self.repeated:
            found.append(f'{self.repeated} rows with the time of the row before left out')
        if self.parts > 1:
            found.append(f'{self.parts} parts: time goes back in {self.parts - 1} places')
        return found

    def nanoseconds(self, times: NDArray[Any]) -> Stamps:
        """Return times of a log, numbers or dates, in ns; -1 where they are missing."""
        if times.dtype.kind == 'O':
            return self._dates(times)
        seconds = times * conversion(self.unit, 'time').factor
        finite = np.isfinite(seconds)
        late = finite & (np.abs(seconds) > _LATEST)
        if late.sum() > 0.5 * finite.sum():
            largest = float(np.abs(times[finite]).max())
            raise InputError(
                f'{self.where}: times reach {largest:.4g} {self.unit}; is that their unit? '
                'expected s, ms, us or ns'
            )
        bad = ~finite | late
        if not self.rows:
            self._check_unit(seconds[~bad])
        whole = np.where(bad, 0.0, seconds)
        relative = len(whole) and float(np.median(whole)) < _EPOCH
        result = np.rint(whole * 1e9).astype(np.int64) + (START * 10**9 if relative else 0)
        return np.where(bad, -1, result)

    def _check_unit(self, seconds: NDArray[np.float64]) -> None:
        """InputError where another unit of time would make a likely rate, and this does not."""
        steps = np.diff(seconds)
        steps = steps[steps > 0]
        if len(steps) < 2:
            return
        rate = 1 / float(np.median(steps))
        if _RATES[0] <= rate <= _RATES[1]:
            return
        unit = conversion(self.unit, 'time').factor
        for other in _UNITS:
            likely = rate * unit / conversion(other, 'time').factor
            if 5 <= likely <= 2e4:
                raise InputError(
                    f'{self.where}: times in {self.unit} make {rate:.3g} rows a second; is that '
                    f'their unit? {other} would make {likely:.3g}: time: {{unit: {other}}}'
                )

    def _dates(self, texts: NDArray[Any]) -> Stamps:
        result = np.full(len(texts), -1, np.int64)
        for i, text in enumerate(texts.tolist()):
            if text is None or not str(text).strip():
                continue
            ordinary = _ORDINARY.match(str(text))
            iso = f'{ordinary[1]}-{ordinary[2]}-{ordinary[3]} {ordinary[4]}' if ordinary else text
            try:
                moment = datetime.fromisoformat(str(iso).strip())
            except ValueError:
                raise InputError(
                    f'{self.where}: {quoted(text)} is no time; expected numbers or dates such as '
                    '2026-11-22T10:00:00.000'
                ) from None
            span = moment - datetime(1970, 1, 1, tzinfo=UTC if moment.tzinfo else None)
            seconds = span.days * 86_400 + span.seconds
            result[i] = seconds * 10**9 + span.microseconds * 1000
        return result
