"""The channels that make one topic, brought to common times."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from power_recordings.importing.derived import PositionRates
from power_recordings.importing.merge import Merger
from power_recordings.importing.plan import LogChannel
from power_recordings.importing.times import TimedRows

Floats = NDArray[np.float64]
Stamps = NDArray[np.int64]

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
    """
    The channels that make one topic, with their drives.

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
        """Add what is kept of the rows of a block of a stream."""
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
        """Return stamps and values by drive and quantity, constants included."""
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
