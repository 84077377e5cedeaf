"""Mapping of a device's clock to ROS time by a running fit of offset and drift.

Every frame carries the device time of its sample and arrives after a delay. Delays are never
negative, so the mapping is the lower envelope of arrival time over device time: the closest line
below all points (Moon, Skelly and Towsley, "Estimation and removal of clock skew from network
delay measurements", INFOCOM 1999). Arrivals are on the steady clock, so that steps of the system
time do not affect the fit.
"""

import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from threading import Event

_MS = 1_000_000
_S = 1_000_000_000

# Limits between noise and changes of the clocks; in ns unless stated otherwise.
_BIN = 100 * _MS  # interval of which the least delayed frame is kept
_WINDOW = 200  # bins that are fitted
_SETTLE = 250 * _MS  # time until stamps are valid
_DRIFT_AFTER = 2 * _S  # time until drift is fitted
_RECENT = 5  # bins that determine the offset before that
_BACKWARD = 20 * _MS  # least step back that is a jump of the device clock
_EARLY = 5 * _MS  # least step ahead, below all delays of the epoch, that is one
_SHIFT = 500_000  # change of the least delay that discards older bins
_SHIFT_BINS = 200  # bins that a rise has to last for that
_CORRECTION = 20 * _MS  # largest change of the mapping that is faded in
_DRIFT = 500e-6  # largest accepted (1)


class WrappingCounter:
    """A counter of a number of bits, unwrapped by its expected advance."""

    def __init__(self, bits: int) -> None:
        self._size = 1 << bits
        self._half = self._size >> 1

    def advance(self, previous: int, current: int, expected: int) -> int:
        """Return the counts from previous to current (raw values) that are nearest to expected."""
        surplus = (current - previous - expected + self._half) % self._size - self._half
        return expected + surplus


Point = tuple[int, int]


def line_below(points: Sequence[Point], largest_slope: float) -> tuple[Point, float] | None:
    """Return a point and the slope of the line below all points with the least mean distance.

    It is the edge of the lower convex hull at the mean of x. None if there is no such edge or it
    is steeper than largest_slope. Points are in the order of x.
    """
    hull: list[Point] = []
    for x, y in points:
        while len(hull) > 1:
            (x1, y1), (x2, y2) = hull[-2], hull[-1]
            if (y2 - y1) * (x - x1) < (y - y1) * (x2 - x1):
                break
            hull.pop()
        hull.append((x, y))
    middle = sum(x for x, _ in points) / max(1, len(points))
    for (x1, y1), (x2, y2) in pairwise(hull):
        if x2 >= middle:
            slope = (y2 - y1) / (x2 - x1) if x2 > x1 else 2 * largest_slope
            return ((x2, y2), slope) if abs(slope) <= largest_slope else None
    return None


class ClockMapping:
    """Maps one device clock to the steady clock of this machine.

    ns_per_tick, bits: of the clock as transmitted. A device clock that jumps or restarts begins a
    new epoch: its offset is unknown, its drift is kept.
    """

    def __init__(self, ns_per_tick: float, bits: int) -> None:
        self._tick = ns_per_tick
        self._counter = WrappingCounter(bits)
        self._raw: int | None = None
        self._ticks = self._arrival = 0
        self.epoch = 0
        self.drift = 0.0  # steady time gained per device time (1)
        self.delay_mean = self.delay_worst = 0.0  # ns beyond the least delay, of the last bin
        self._begin(0, 0)

    def _begin(self, device: int, lag: int) -> None:
        self._start = self._newest = device
        self.settled = False  # whether stamps of this epoch are valid
        self._base = lag
        self._floor, self._floor_at = 0.0, device
        self._fade_from, self._correction = device, 0.0
        self._forget(device, lag)

    def _forget(self, device: int, lag: int) -> None:
        """Restart the fit from one point and keep the drift."""
        self._fit_start = device
        self._points: deque[Point] = deque(maxlen=_WINDOW)
        self._floors: deque[float] = deque(maxlen=_SHIFT_BINS)
        self._anchor, self._level = device, float(lag - self._base)
        self._open_bin(device, lag)

    def _open_bin(self, device: int, lag: int) -> None:
        self._bin_end = device - device % _BIN + _BIN
        self._best = device, lag
        self._least = lag - self._base - self._line(device)
        self._sum, self._count, self._worst = 0.0, 0, 0.0

    def update(self, raw: int, arrival: int) -> int:
        """Take the raw device time of a frame and its arrival in ns on the steady clock.

        Returns the device time in ns, unwrapped since the start of the epoch.
        """
        if self._raw is None:
            return self._restart(raw, arrival)
        elapsed = arrival - self._arrival
        gained = self._counter.advance(self._raw, raw, round(elapsed / self._tick))
        self._ticks += gained
        self._raw, self._arrival = raw, arrival
        device = round(self._ticks * self._tick)
        lag = arrival - device
        late = lag - self._base - self._line(device)
        drifting = device - self._fit_start >= _DRIFT_AFTER
        backward = device < self._newest - _BACKWARD
        leapt = gained * self._tick - elapsed > _EARLY
        if backward or (leapt and drifting and self._below_all(device, lag)):
            self.epoch += 1
            return self._restart(raw, arrival)
        self._newest = max(self._newest, device)
        self._sum += late
        self._count += 1
        self._worst = max(self._worst, late)
        if late < self._least:
            self._best, self._least = (device, lag), late
            if late < (-_SHIFT if drifting else 0):
                self._move(device, lag, drifting)
        if device >= self._bin_end:
            self._close_bin(device, lag)
        return device

    def _restart(self, raw: int, arrival: int) -> int:
        self._raw, self._ticks, self._arrival = raw, raw, arrival
        device = round(raw * self._tick)
        self._begin(device, arrival - device)
        return device

    def _below_all(self, device: int, lag: int) -> bool:
        """Return whether a frame is earlier than all others of this epoch.

        A frame that is only earlier than the line may end a period in which all frames were late
        and the line rose. A restart of a late device, by less than it was late, is not detected
        here, but by the counters of its frames.
        """
        floor = self._floor + self.drift * (device - self._floor_at)
        return lag - self._base < floor - _EARLY

    def _sink(self, device: int) -> None:
        """Lower the floor to the line, and move it with the drift."""
        floor = self._floor + self.drift * (device - self._floor_at)
        self._floor, self._floor_at = min(floor, self._line(device)), device

    def _move(self, device: int, lag: int, forget: bool) -> None:
        """Lower the line to a point below it."""
        published = self._published(device)
        if forget:
            self._forget(device, lag)
        else:
            self._anchor, self._level = device, float(lag - self._base)
            self._least = 0.0
        self._sink(device)
        self._blend(device, published)

    def _close_bin(self, device: int, lag: int) -> None:
        self.delay_mean = self._sum / self._count if self._count else 0.0
        self.delay_worst = self._worst
        x, y = self._best
        self._points.append((x - self._start, y - self._base))
        self._floors.append(self._least)
        if len(self._floors) == _SHIFT_BINS and min(self._floors) > _SHIFT:
            self._points = deque(list(self._points)[-_RECENT:], _WINDOW)
            self._floors.clear()
        published = self._published(device)
        self._fit(device)
        self._sink(device)
        self._blend(device, published)
        self.settled = self.settled or device - self._start >= _SETTLE
        self._open_bin(device, lag)

    def _fit(self, device: int) -> None:
        if self._points[-1][0] - self._points[0][0] >= _DRIFT_AFTER:
            found = line_below(self._points, _DRIFT)
            # None: delays grow faster than clocks drift, as when the sender falls behind.
            if found is not None:
                (x, y), self.drift = found
                self._anchor, self._level = x + self._start, float(y)
            return
        recent = list(self._points)[-_RECENT:]
        origin = self._points[-1][0]
        self._anchor = origin + self._start
        self._level = min(y - self.drift * (x - origin) for x, y in recent)

    def _blend(self, device: int, published: float) -> None:
        self._fade_from = device
        self._correction = published - self._line(device) if self.settled else 0.0
        if abs(self._correction) > _CORRECTION:
            self.epoch += 1
            self._correction = 0.0

    def _line(self, device: int) -> float:
        return self._level + self.drift * (device - self._anchor)

    def _published(self, device: int) -> float:
        fade = 1.0 - (device - self._fade_from) / _BIN
        return self._line(device) + self._correction * min(1.0, max(0.0, fade))

    def to_steady(self, device: int) -> int:
        """Return the steady time (ns) of a device time (ns)."""
        return device + self._base + round(self._published(device))

    @property
    def offset(self) -> float:
        """Steady time minus device time at the newest frame, s."""
        return (self._base + self._line(self._newest)) / _S


class RosTime:
    """Conversion of the steady clock to the system clock.

    Their difference is measured again and again, so that stamps agree with the ROS time of other
    nodes. A step of more than 1 ms is counted and begins a new epoch, in which stamps may
    repeat.
    """

    def __init__(
        self,
        now: Callable[[], int] = time.time_ns,
        steady: Callable[[], int] = time.monotonic_ns,
        period: int = 100 * _MS,
    ) -> None:
        self._now, self._steady, self._period = now, steady, period
        self.steps = 0
        self.offset = self._measure()
        self._next = steady() + period

    def _measure(self) -> int:
        """Return ROS minus steady time, ns, by the shortest of three readings."""
        readings = []
        for _ in range(3):
            before = self._steady()
            now = self._now()
            after = self._steady()
            readings.append((after - before, now - (before + after) // 2))
        return min(readings)[1]

    def follow(self, steady: int) -> None:
        """Measure the difference again, at most once a period."""
        if steady < self._next:
            return
        self._next = steady + self._period
        offset = self._measure()
        if abs(offset - self.offset) > _MS:
            self.steps += 1
        self.offset = offset

    def of(self, steady: int) -> int:
        """Return the ROS time (ns) of a steady time (ns)."""
        return steady + self.offset


class Stamper:
    """Stamps in ROS time, each later than the one before unless a clock jumped in between."""

    def __init__(self, ros_time: RosTime) -> None:
        self._ros_time = ros_time
        self._last, self._epoch = 0, -1

    def of(self, steady: int, jumps: int = 0) -> int:
        """Return the stamp (ns) of a steady time (ns); jumps: of the device's clock so far."""
        stamp = self._ros_time.of(steady)
        epoch = jumps + self._ros_time.steps
        if epoch == self._epoch:
            stamp = max(stamp, self._last + 1)
        self._last, self._epoch = stamp, epoch
        return stamp


class Slots:
    """Slots of `period` s, counted from the first use of `each`.

    A slot that is missed is not made up for: the next one is the first that begins from now on.
    """

    def __init__(self, period: float) -> None:
        self.period = period
        self._start: float | None = None
        self._lost = 0

    def each(self, stop: Event) -> Iterator[int]:
        """Yield the index of each slot when it begins, until `stop` is set."""
        if self._start is None:
            self._start = time.monotonic()
        slot = self._next()
        while not stop.wait(self._start + slot * self.period - time.monotonic()):
            yield slot
            slot = max(slot + 1, self._next())

    def _next(self) -> int:
        return -int(-self._elapsed() // self.period)

    def _elapsed(self) -> float:
        return 0.0 if self._start is None else time.monotonic() - self._start

    def lost(self, samples: int) -> int:
        """Return the number of slots that have ended without one of so many samples."""
        self._lost = max(self._lost, int(self._elapsed() / self.period) - 1 - samples)
        return self._lost
