"""State of a running measurement, and views of it."""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite, nan
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from power_recordings.messages.samples import DriveSamples, EstimateSamples, Samples, SupplySamples
from power_recordings.reading.topic_buffers import TopicBuffer, TopicCounter
from power_recordings.writing.background import SequenceCheck
from wattwalk_core.recent_power import REPORT, RecentBudget, RecentMean, parts_of

from power_daq.supply.energy_counters import EnergyCounter

T = TypeVar('T')
TOPICS = ('drive_supply', 'joint_states', 'supply', 'power_estimate', 'diagnostics')
"""Topics that are watched."""
FRESH = 2.0  # s, after which a figure no longer counts as of now
_SLOWEST = 1.0  # s between samples of the slowest stream
_STEPS = 1000
_WH = 3600.0  # J
_FLAGS = {1: 'under range', 2: 'over range', 4: 'device error', 8: 'stale'}
_ESTIMATE = ('ok', 'warming up', 'input stale', 'outside its training data')


@dataclass(frozen=True)
class StatusReport:
    """A status on `diagnostics`: level 0 to 3, a sentence, figures by name, and its arrival."""

    level: int
    sentence: str
    figures: Mapping[str, str]
    time: float


@dataclass(frozen=True)
class TopicView:
    """Rate since the last view and age of the newest message in s (None: no message)."""

    name: str
    rate: float
    age: float | None


@dataclass(frozen=True)
class DriveView:
    """One drive: means since the last view in W and °C; NaN if unknown."""

    name: str
    power: float
    estimate: float
    temperature: float
    status: str


@dataclass(frozen=True)
class View:
    """The measurement at one time, in W, V, A and J; NaN if unknown."""

    seconds: float
    drives: tuple[DriveView, ...]
    total: float
    estimate: float
    estimate_status: str
    model: str
    supply: float
    voltage: float
    current: float
    drive_energy: float
    supply_energy: float
    budget: RecentBudget
    hours: float  # that the battery lasts
    missed: int
    topics: tuple[TopicView, ...]
    reports: Mapping[str, StatusReport]
    warnings: tuple[str, ...]

    @property
    def electronics(self) -> float:
        """Power of the supply less that of the drives, W."""
        return self.supply - self.total


class _Meter:
    """Energy of a stream whose period is the median of its latest steps, and its recent mean."""

    def __init__(self) -> None:
        self.recent = RecentMean()
        self._counter = EnergyCounter(_SLOWEST)
        self._steps: deque[float] = deque(maxlen=_STEPS)
        self._last: int | None = None

    def add(self, stamp_ns: NDArray[np.int64], power: NDArray[np.float64]) -> None:
        self.recent.add(stamp_ns, power)
        stamps: list[int] = stamp_ns.tolist()
        steps = np.diff([stamps[0] if self._last is None else self._last, *stamps]) / 1e9
        self._last = stamps[-1]
        self._steps.extend(steps[steps > 0].tolist())
        if self._steps:
            self._counter.period = min(float(np.median(self._steps)), _SLOWEST)
        for stamp, watts in zip(stamps, power.tolist(), strict=True):
            self._counter.add(stamp, watts)

    @property
    def joule(self) -> float:
        """Energy so far, J; NaN before the second sample."""
        energy = self._counter.total()
        return energy.joule if energy.seconds else nan


@dataclass
class MonitorState:
    """Takes messages at any rate; `view` summarises those since the last view.

    Times are in s on a steady clock; battery: energy in the battery at the start, Wh.
    """

    started: float
    battery: float = nan
    reports: dict[str, StatusReport] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.buffers = {
            name: TopicBuffer(name) for name in ('drive_supply', 'supply', 'power_estimate')
        }
        self.counters = {name: TopicCounter() for name in ('joint_states', 'diagnostics')}
        self._sequence = SequenceCheck()
        self._meters = {name: _Meter() for name in ('drive_supply', 'supply')}
        self._last_view = self.started
        self._before = dict.fromkeys(TOPICS, 0)
        self._newest: dict[str, Samples] = {}

    def source(self, topic: str) -> TopicBuffer | TopicCounter:
        """Return the buffer or counter of a topic's messages."""
        return self.buffers.get(topic) or self.counters[topic]

    def report(
        self, name: str, level: int, sentence: str, figures: Mapping[str, str], now: float
    ) -> None:
        """Keep a status from `diagnostics`; level: 0 to 3; figures: by name; now: s."""
        self.reports[name] = StatusReport(level, sentence, figures, now)

    def view(self, now: float) -> View:
        """Return the view of what arrived since the last one."""
        span = max(now - self._last_view, 1e-3)
        self._last_view = now
        topics = []
        for name in TOPICS:
            source = self.source(name)
            rate = (source.count - self._before[name]) / span
            age = None if source.last is None else now - source.last
            topics.append(TopicView(name, rate, age))
            self._before[name] = source.count
        self._take()
        drives = self._fresh('drive_supply', DriveSamples, now)
        supply = self._fresh('supply', SupplySamples, now)
        found = self._fresh('power_estimate', EstimateSamples, now)
        power = {} if drives is None else _by_name(drives.names, drives.power)
        guess = {} if found is None else _by_name(found.names, found.power)
        celsius = {} if drives is None else _by_name(drives.names, drives.temperature)
        flags = {} if drives is None else dict(zip(drives.names, _words(drives), strict=True))
        budget = self._budget(now)
        joule = {name: meter.joule for name, meter in self._meters.items()}
        drawn = joule['supply'] if isfinite(joule['supply']) else joule['drive_supply']
        return View(
            seconds=now - self.started,
            drives=tuple(
                DriveView(
                    name,
                    power.get(name, nan),
                    guess.get(name, nan),
                    celsius.get(name, nan),
                    flags.get(name, ''),
                )
                for name in dict.fromkeys([*power, *guess])
            ),
            total=sum(power.values()) if power else nan,
            estimate=nan if found is None else _mean(found.total),
            estimate_status='' if found is None else _ESTIMATE[min(int(found.status.max()), 3)],
            model='' if found is None else found.model[-1],
            supply=nan if supply is None else _mean(supply.power),
            voltage=nan if supply is None else _mean(supply.voltage),
            current=nan if supply is None else _mean(supply.current),
            drive_energy=joule['drive_supply'],
            supply_energy=joule['supply'],
            budget=budget,
            hours=budget.hours(self.battery - drawn / _WH),
            missed=self._sequence.lost,
            topics=tuple(topics),
            reports=dict(self.reports),
            warnings=tuple(self._warnings(now)),
        )

    def _take(self) -> None:
        for topic, buffer in self.buffers.items():
            raw, samples = buffer.drain()
            if topic == 'drive_supply':
                for cdr in raw:
                    self._sequence.feed(cdr)
            if samples is None or not len(samples):
                continue
            self._newest[topic] = samples
            if isinstance(samples, DriveSamples | SupplySamples):
                watts = samples.power.astype(np.float64).reshape(len(samples), -1).sum(axis=1)
                self._meters[topic].add(samples.stamp_ns, watts)

    def _fresh(self, topic: str, kind: type[T], now: float) -> T | None:
        """Return the newest samples of a topic; None once it no longer comes."""
        samples, last = self._newest.get(topic), self.buffers[topic].last
        is_fresh = last is not None and now - last <= FRESH
        return samples if is_fresh and isinstance(samples, kind) else None

    def _budget(self, now: float) -> RecentBudget:
        drives, supply = (
            nan if self._fresh(topic, Samples, now) is None else self._meters[topic].recent.value
            for topic in ('drive_supply', 'supply')
        )
        found = [
            parts_of(report.figures)
            for name, report in self.reports.items()
            if name.endswith(REPORT) and now - report.time <= FRESH
        ]
        return RecentBudget.of(found[-1] if found else {}, drives, supply)

    def _warnings(self, now: float) -> list[str]:
        found = []
        last = self.buffers['drive_supply'].last
        if last is None:
            found.append('no drive_supply yet: start `ros2 run power_daq daq`')
        elif now - last > FRESH:
            found.append(f'no drive_supply for {now - last:.0f} s')
        found += [
            f'{name}: {buffer.fault}' for name, buffer in self.buffers.items() if buffer.fault
        ]
        for name, report in sorted(self.reports.items(), key=lambda item: -item[1].level):
            if now - report.time > 2 * FRESH:
                found.append(f'{name}: silent for {now - report.time:.0f} s')
            elif report.level:
                found.append(f'{name}: {report.sentence}')
        return found


def _by_name(names: Sequence[str], values: NDArray[np.floating]) -> dict[str, float]:
    return {name: _mean(column) for name, column in zip(names, values.T, strict=True)}


def _mean(values: NDArray[np.floating]) -> float:
    good = values[np.isfinite(values)]
    return float(good.mean(dtype=np.float64)) if len(good) else nan


def _words(drives: DriveSamples) -> list[str]:
    """Return the status of each drive in words: every flag since the last view."""
    seen = np.bitwise_or.reduce(drives.status, axis=0).tolist()
    return [
        ', '.join(word for bit, word in _FLAGS.items() if flags & bit)
        or ('ok' if not flags else f'flags {flags}')
        for flags in seen
    ]
