"""The channels that make one topic, brought to common times."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.arrays import Floats, Stamps

from power_recordings.importing.plan import LogChannel
from power_recordings.importing.times import TimedRows
from power_recordings.reading.ordering import longest_step

HALF_WINDOW: Final = 0.01  # s
_TURN: Final = 2 * np.pi


@dataclass
class PositionRates:
    """Velocities from positions by central differences, for rows that arrive in blocks.

    v[i] = (q[i + w] − q[i − w]) / (t[i + w] − t[i − w]), with w the rows of 10 ms, at least one.
    It does not lag; it is NaN at both ends and across gaps. A position within one turn that
    jumps by more than half of it is taken for one that wraps. columns: indices of positions.
    """

    columns: Sequence[int]
    _stamps: Stamps = field(default_factory=lambda: np.zeros(0, np.int64))
    _rows: Floats | None = None
    _fresh: int = 0  # first row that was not given out
    _half: int = 0

    def extend(self, stamps: Stamps, rows: Floats, *, final: bool) -> tuple[Stamps, Floats]:
        """Take stamps [N] in ns and rows [N, K]; return the rows whose rates are complete.

        Returns stamps [M] and rows with rates [M, K + len(columns)]; `final` returns all the rest.
        """
        if self._rows is not None:
            stamps = np.concatenate([self._stamps, stamps])
            rows = np.concatenate([self._rows, rows])
        if not self._half and len(stamps) > 2:
            period = float(np.median(np.diff(stamps))) / 1e9
            self._half = max(1, round(HALF_WINDOW / period))
        count, half = len(stamps), max(self._half, 1)
        stop = count if final else max(count - half, self._fresh)
        out = slice(self._fresh, stop)
        rates = self._rates(stamps, rows, half)[out]
        keep = max(stop - half, 0)
        self._stamps, self._rows, self._fresh = stamps[keep:], rows[keep:], stop - keep
        return stamps[out], np.concatenate([rows[out], rates], axis=1)

    def _rates(self, stamps: Stamps, rows: Floats, half: int) -> Floats:
        result = np.full((len(rows), len(self.columns)), np.nan)
        if len(rows) <= 2 * half:
            return result
        span = (stamps[2 * half :] - stamps[: -2 * half]) / 1e9
        whole = span <= longest_step(span)
        for k, column in enumerate(self.columns):
            position = rows[:, column].copy()
            finite = np.isfinite(position)
            if finite.any() and np.ptp(position[finite]) <= 1.01 * _TURN:
                position[finite] = np.unwrap(position[finite], period=_TURN)
            steps = position[2 * half :] - position[: -2 * half]
            result[half:-half, k] = np.where(whole, steps / span, np.nan)
        return result


class _Buffer:
    """The rows of one stream that are still needed."""

    def __init__(self, width: int) -> None:
        self.width = width
        self.stamps: Stamps = np.zeros(0, np.int64)
        self.values: Floats = np.zeros((0, width))
        self.longest = 0.0  # ns, of steps that are no gaps

    def add(self, stamps: Stamps, values: Floats) -> None:
        self.stamps = np.concatenate([self.stamps, stamps])
        self.values = np.concatenate([self.values, values])
        if len(self.stamps) > 2:
            self.longest = 1e9 * longest_step(np.diff(self.stamps[:1000]) / 1e9)

    def at(self, stamps: Stamps) -> Floats:
        """Linear interpolation, NaN outside the rows and in gaps."""
        result = np.full((len(stamps), self.width), np.nan)
        if len(self.stamps) < 2:
            if len(self.stamps):
                result[stamps == self.stamps[0]] = self.values[0]
            return result
        right = np.clip(np.searchsorted(self.stamps, stamps), 1, len(self.stamps) - 1)
        left = right - 1
        span = (self.stamps[right] - self.stamps[left]).astype(np.float64)
        weight = (stamps - self.stamps[left]) / span
        rows = self.values[left] * (1 - weight)[:, None] + self.values[right] * weight[:, None]
        for end, side in ((0.0, left), (1.0, right)):
            rows[weight == end] = self.values[side[weight == end]]
        exact = (weight == 0) | (weight == 1)
        inside = (weight >= 0) & (weight <= 1) & ((span <= self.longest) | exact)
        result[inside] = rows[inside]
        return result

    def forget(self, before: int) -> None:
        keep = max(int(np.searchsorted(self.stamps, before)) - 1, 0)
        self.stamps, self.values = self.stamps[keep:], self.values[keep:]


class Merger:
    """Brings the columns of several streams to the times of the first, the reference.

    widths: number of columns of each stream. `add` takes rows as they are read; `take` returns the
    reference's rows, all columns side by side, up to the latest time that every stream has.
    """

    def __init__(self, widths: Sequence[int]) -> None:
        self._all = [_Buffer(width) for width in widths]
        self._reference, *self._others = self._all

    def add(self, stream: int, stamps: Stamps, values: Floats) -> None:
        """Add rows [N, K] of a stream, given by its index; stamps [N] in ns ascend."""
        self._all[stream].add(stamps, values)

    def take(self, *, final: bool = False) -> tuple[Stamps, Floats]:
        """Return stamps [N] and values [N, sum of widths]; with final, all rows that are left."""
        reference = self._reference
        count = len(reference.stamps)
        if not final:
            for other in self._others:
                last = int(other.stamps[-1]) if len(other.stamps) else -1
                count = min(count, int(np.searchsorted(reference.stamps, last, side='right')))
        stamps, rows = reference.stamps[:count], reference.values[:count]
        reference.stamps, reference.values = reference.stamps[count:], reference.values[count:]
        if not count:
            return stamps, np.zeros((0, sum(buffer.width for buffer in self._all)))
        merged = np.concatenate([rows, *(other.at(stamps) for other in self._others)], axis=1)
        for other in self._others:
            other.forget(int(stamps[-1]))
        return stamps, merged


LARGEST: Final = 1e12  # in SI units, of what is taken for a number; instruments send 9.91e37
_DENSE: Final = 0.8  # share of rows with a value, below which a column has times of its own


@dataclass(frozen=True)
class _Feed:
    """Channels, by index, that have values in the same rows of a stream."""

    stream: str
    channels: tuple[int, ...]
    sparse: bool = False


@dataclass
class ChannelGroup:
    """The channels that make one topic, with their drives.

    Columns of a table that have values in some rows only (torque at 5 Hz beside power at 100 Hz,
    or topics that take turns) count as streams of their own. All streams are put on the times of
    one: of the rarer of torque and velocity, of the most frequent of current and power, else of
    the one with most channels. `filled` tells the share of rows that such columns have values in.
    """

    channels: Sequence[tuple[str, LogChannel]]
    derived: tuple[str, ...] = ()  # drives whose velocity is the rate of their position
    filled: dict[str, float] = field(default_factory=dict)
    _feeds: list[_Feed] = field(default_factory=list)
    _merger: Merger | None = None
    _order: list[int] = field(default_factory=list)
    _rates: PositionRates | None = None

    def __post_init__(self) -> None:
        members: dict[str, list[int]] = {}
        for i, (_, channel) in enumerate(self.channels):
            if channel.stream is not None:
                members.setdefault(channel.stream, []).append(i)
        feeds = [_Feed(stream, tuple(indices)) for stream, indices in members.items()]
        self._feeds = sorted(feeds, key=lambda feed: -len(feed.channels))
        if len(feeds) > 1:
            self._begin()

    def _begin(self) -> None:
        self._merger = Merger([len(feed.channels) for feed in self._feeds])
        self._order = [i for feed in self._feeds for i in feed.channels]
        if self.derived:
            places = [(d, c.quantity) for d, c in (self.channels[i] for i in self._order)]
            self._rates = PositionRates([places.index((d, 'position')) for d in self.derived])

    def add(self, stream: str, block: Mapping[str, NDArray[Any]], rows: TimedRows) -> None:
        """Add a block of a stream: its columns by address, of which `rows` are kept."""
        if not any(feed.stream == stream for feed in self._feeds):
            return
        if self._merger is None:
            self._split(self._values(self._feeds[0], block, rows))
            self._begin()
        assert self._merger is not None
        for number, feed in enumerate(self._feeds):
            if feed.stream != stream:
                continue
            values, stamps = self._values(feed, block, rows), rows.stamps
            if feed.sparse:
                there = np.isfinite(values).any(axis=1)
                values, stamps = values[there], stamps[there]
            self._merger.add(number, stamps, values)

    def _values(self, feed: _Feed, block: Mapping[str, NDArray[Any]], rows: TimedRows) -> Floats:
        chosen = [self.channels[i][1] for i in feed.channels]
        kept = {a: rows.of(block[a]) for channel in chosen for a in channel.addresses}
        with np.errstate(over='ignore', invalid='ignore'):
            values = np.stack([channel.convert(kept) for channel in chosen], axis=1)
            if not np.abs(values).max(initial=0.0) < LARGEST:
                values[~(np.abs(values) < LARGEST)] = np.nan
        return values

    def _split(self, values: Floats) -> None:
        """Give columns that have values in some rows only feeds of their own."""
        feed = self._feeds[0]
        there = np.isfinite(values)
        share = there.mean(axis=0) if len(values) else np.ones(len(feed.channels))
        kinds: dict[bytes, list[int]] = {}
        for column, i in enumerate(feed.channels):
            sparse = 0.0 < share[column] < _DENSE
            kinds.setdefault(there[:, column].tobytes() if sparse else b'', []).append(i)
            if sparse:
                self.filled[self.channels[i][1].formula] = float(share[column])
        shares = dict(zip(feed.channels, share.tolist(), strict=True))
        feeds = [_Feed(feed.stream, tuple(own), bool(key)) for key, own in kinds.items()]

        def rank(feed: _Feed) -> tuple[int, float]:
            quantities = {self.channels[i][1].quantity for i in feed.channels}
            rows = max(shares[i] for i in feed.channels)
            if {'torque', 'velocity'} & quantities:
                return 0, rows
            return (0 if {'current', 'power'} & quantities else 1), -rows

        self._feeds = sorted(feeds, key=rank)

    def take(self, *, final: bool) -> tuple[Stamps, dict[tuple[str, str], Floats]]:
        """Return stamps [N] in ns and SI values [N] by (drive, quantity), constants included.

        Rows that still lack other streams wait for the next call, unless `final`.
        """
        if self._merger is None:
            return np.zeros(0, np.int64), {}
        stamps, rows = self._merger.take(final=final)
        if self._rates is not None:
            stamps, rows = self._rates.extend(stamps, rows, final=final)
        found = {
            (self.channels[i][0], self.channels[i][1].quantity): rows[:, column]
            for column, i in enumerate(self._order)
        }
        for k, drive in enumerate(self.derived):
            found[drive, 'velocity'] = rows[:, len(self._order) + k]
        for drive, channel in self.channels:
            if not channel.terms:
                found[drive, channel.quantity] = np.full(len(stamps), channel.constant())
        return stamps, found
