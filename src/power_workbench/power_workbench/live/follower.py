"""Messages of the topics, decoded in blocks, beside the estimate of a model; without ROS."""

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, nan
from pathlib import Path
from typing import Any

import numpy as np
from power_estimator.effects import load_catalogue
from power_estimator.live.estimator import Status
from power_estimator.live.session import MESSAGES, LiveSession, Vector
from power_estimator.loader import load_model
from power_recordings.messages.samples import (
    DriveSamples,
    EstimateSamples,
    JointSamples,
    SupplySamples,
)
from power_recordings.reading.topic_buffers import TopicBuffer
from wattwalk_core.arrays import Floats, Stamps
from wattwalk_core.console import finite
from wattwalk_core.errors import InputError
from wattwalk_core.recent_power import RecentBudget, RecentMean, parts_of

PERIOD = 20_000_000
"""ns, that a row covers."""
_PATIENCE = 300_000_000  # ns, that an estimate may come after its measurement, or before it
_KEPT = 3_000_000_000  # ns of measurements
_MOST_WAITING = 500  # estimates


@dataclass(frozen=True)
class PowerRows:
    """Mean power over the 20 ms before each stamp, W [N, D + 1]; NaN where unknown.

    The last column is the sum: of the drives that are estimated, where there is an estimate.
    """

    stamp_ns: Stamps  # [N], ascending
    names: tuple[str, ...]  # [D]
    measured: Floats
    estimate: Floats


class RollingPower:
    """Joins measurements and estimates, given in the order of their stamps, to rows of 20 ms.

    A row ends at the stamp of an estimate, so that both cover the same time. While no estimate
    comes, rows follow one another without one.
    """

    def __init__(self) -> None:
        self.names: tuple[str, ...] = ()
        self._forget()

    def _forget(self) -> None:
        self._stamps: Stamps = np.zeros(0, np.int64)
        self._power: Floats = np.zeros((0, len(self.names)))
        self._waiting: deque[tuple[int, Floats]] = deque(maxlen=_MOST_WAITING)
        self._end = 0  # of the last row

    def measured(self, names: Sequence[str], stamp_ns: Stamps, power: Floats) -> None:
        """Take measured power W [n, D] with ascending stamps [n]; NaN for what does not count."""
        self._use(names)
        if len(self._stamps) and len(stamp_ns) and stamp_ns[0] < self._stamps[-1] - _KEPT:
            self._forget()  # time was set back: another simulation
        given = np.full((len(stamp_ns), len(self.names)), np.nan)
        given[:, [self.names.index(name) for name in names]] = power
        self._stamps = np.concatenate([self._stamps, stamp_ns])
        self._power = np.concatenate([self._power, given])
        recent = self._stamps > self._stamps[-1] - _KEPT if len(self._stamps) else slice(None)
        self._stamps, self._power = self._stamps[recent], self._power[recent]

    def estimated(self, names: Sequence[str], stamp: int, power: Floats) -> None:
        """Take an estimate in W [D] over the 20 ms before its stamp (ns)."""
        self._use(names)
        row = np.full(len(self.names), np.nan)
        row[[self.names.index(name) for name in names]] = power
        if self._waiting and stamp < self._waiting[-1][0] - _KEPT:
            self._forget()
        self._waiting.append((stamp, row))

    def rows(self) -> PowerRows | None:
        """Return the rows that were completed since the last call, None where there are none."""
        newest = int(self._stamps[-1]) if len(self._stamps) else 0
        last = self._waiting[-1][0] if self._waiting else 0
        found: list[tuple[int, Floats]] = []  # end of a row, and the estimate
        while self._waiting and self._waiting[0][0] <= max(newest, last - _PATIENCE):
            end, row = self._waiting.popleft()
            if end > self._end:
                found += self._without_estimate(end - PERIOD)
                found.append((end, row))
                self._end = end
        found += self._without_estimate(newest - _PATIENCE)
        if not found:
            return None
        stamps = np.array([end for end, _ in found], np.int64)
        estimate = np.array([row for _, row in found])
        return PowerRows(stamps, self.names, *_with_sum(self._means(stamps), estimate))

    def _without_estimate(self, until: int) -> Iterator[tuple[int, Floats]]:
        """Rows without an estimate from the last one to a stamp."""
        if len(self._stamps):
            self._end = max(self._end, int(self._stamps[0]))
            while self._end + PERIOD <= until:
                self._end += PERIOD
                yield self._end, np.full(len(self.names), np.nan)

    def _means(self, ends: Stamps) -> Floats:
        """Mean of the measured samples in the 20 ms before each end, [N, D]."""
        known = np.isfinite(self._power)
        blank = np.zeros((1, len(self.names)))
        sums = np.concatenate([blank, np.cumsum(np.where(known, self._power, 0.0), axis=0)])
        counts = np.concatenate([blank, np.cumsum(known, axis=0)])
        first = np.searchsorted(self._stamps, ends - PERIOD, side='right')
        past = np.searchsorted(self._stamps, ends, side='right')
        number = counts[past] - counts[first]
        total = sums[past] - sums[first]
        return np.where(number > 0, total / np.maximum(number, 1.0), np.nan)

    def _use(self, names: Sequence[str]) -> None:
        """Keep columns for drives that come later than others, too."""
        new = [name for name in names if name not in self.names]
        if not new:
            return
        self.names = (*self.names, *new)
        more = np.full((len(self._power), len(new)), np.nan)
        self._power = np.concatenate([self._power, more], axis=1)
        blank = np.full(len(new), np.nan)
        for index, (stamp, row) in enumerate(self._waiting):
            self._waiting[index] = (stamp, np.concatenate([row, blank]))


def _with_sum(measured: Floats, estimate: Floats) -> tuple[Floats, Floats]:
    """Append the sums over the drives that are known in both, or in the only one there is."""
    both = np.isfinite(measured) & np.isfinite(estimate)
    out = []
    for values in (measured, estimate):
        known = np.isfinite(values)
        counted = np.where(both.any(axis=1, keepdims=True), both, known)
        total = np.where(counted, np.nan_to_num(values), 0.0).sum(axis=1, keepdims=True)
        total[~known.any(axis=1)] = np.nan
        out.append(np.concatenate([values, total], axis=1))
    return out[0], out[1]


TOPICS = ('drive_supply', 'supply', 'joint_states', 'joint_commands', 'power_estimate')
"""Topics that are followed."""
_SILENT = 3.0  # s without a message, after which it is said
_SPAN = 1.0  # s over which a rate is counted


class LiveFollower:
    """Decodes what has come on the topics, and returns what the page shows of it.

    Estimates are those of a model given to `use`, else of the topic `power_estimate`. Times are in
    s on a steady clock.
    """

    def __init__(self, started: float) -> None:
        self.buffers = {topic: TopicBuffer(topic) for topic in TOPICS}
        self._started = started
        self._rolling = RollingPower()
        self._drives, self._supply = RecentMean(), RecentMean()
        self._reported: tuple[float, Mapping[str, float]] = (-np.inf, {})
        self._spec = self._fault = ''
        self._session: LiveSession | None = None
        self._status = Status.WARMING_UP
        self._model_on_topic = ''
        self._rates = dict.fromkeys(TOPICS, 0.0)
        self._counted = dict.fromkeys(TOPICS, 0)
        self._counted_at = started

    def use(self, spec: str, effect_files: Sequence[str] = ()) -> None:
        """Estimate with model `spec`, '' for `power_estimate`; `news` reports one that fails."""
        self._spec, self._fault, self._session = spec, '', None
        self._status = Status.WARMING_UP
        try:
            if spec:
                catalogue = load_catalogue([Path(file) for file in effect_files])
                self._session = LiveSession(load_model(spec, catalogue))
        except InputError as error:
            self._fault = str(error)

    def report(self, figures: Mapping[str, str], now: float) -> None:
        """Take the estimator's budget on `diagnostics`, {'PART [W]': text}, at now [s]."""
        self._reported = now, parts_of(figures)

    def news(self, now: float) -> dict[str, Any]:
        """Decode what has come; return new rows, rates, faults and budget as content of JSON."""
        drained = {topic: buffer.drain()[1] for topic, buffer in self.buffers.items()}
        measured, supply, states, commands, published = drained.values()
        if isinstance(measured, DriveSamples) and len(measured):
            power = np.where(measured.good, measured.power, np.nan).astype(np.float64)
            self._rolling.measured(measured.names, measured.stamp_ns, power)
            self._drives.add(measured.stamp_ns, power.sum(axis=1))
        if isinstance(supply, SupplySamples) and len(supply):
            self._supply.add(supply.stamp_ns, supply.power)
        if self._session is not None:
            try:
                self._estimate(self._session, measured, commands, states, now)
            except InputError as error:
                self._session, self._fault = None, str(error)
        elif not self._spec and isinstance(published, EstimateSamples):
            self._take_published(published)
        return {**_content(self._rolling.rows()), **self._state(now), 'budget': self._budget(now)}

    def _estimate(
        self, session: LiveSession, supply: Any, commands: Any, states: Any, now: float
    ) -> None:
        if isinstance(commands, JointSamples):
            for stamp, row in zip(commands.stamp_ns.tolist(), commands.position, strict=True):
                session.command(Vector(stamp, commands.names, row[None].astype(float)), now)
        if not isinstance(states, JointSamples):
            return
        if isinstance(supply, DriveSamples) and len(supply):
            last = np.stack([supply.voltage[-1], supply.temperature[-1]]).astype(float)
            session.electrical(Vector(int(supply.stamp_ns[-1]), supply.names, last), now)
        values = np.stack([states.position, states.velocity, states.effort], axis=1)
        for stamp, rows in zip(states.stamp_ns.tolist(), values.astype(float), strict=True):
            found = session.joint_state(Vector(stamp, states.names, rows), now)
            if found is not None:
                self._status = found.status
                power = found.power.astype(float)
                self._rolling.estimated(session.drives, found.stamp, power)

    def _take_published(self, published: EstimateSamples) -> None:
        for index, stamp in enumerate(published.stamp_ns.tolist()):
            power = published.power[index].astype(float)
            self._rolling.estimated(published.names, stamp, power)
        if len(published):
            self._model_on_topic = published.model[-1]
            self._status = Status(min(int(published.status[-1]), 3))

    def _budget(self, now: float) -> dict[str, Any]:
        """Parts of the power of the last ten seconds, W, and what was metered."""
        at, model = self._reported
        if self._spec:
            model = {} if self._session is None else self._session.budget.parts
        elif now - at > _SILENT:
            model = {}
        metered = (
            nan if self._silence(topic, now) else mean.value
            for topic, mean in (('drive_supply', self._drives), ('supply', self._supply))
        )
        found = RecentBudget.of(model, *metered)
        watts = round(found.metered, 3) if isfinite(found.metered) else None
        return {'parts': {n: round(w, 3) for n, w in found.parts.items()}, 'metered_w': watts}

    def _state(self, now: float) -> dict[str, Any]:
        span = now - self._counted_at
        if span >= _SPAN:
            for topic, buffer in self.buffers.items():
                self._rates[topic] = (buffer.count - self._counted[topic]) / span
                self._counted[topic] = buffer.count
            self._counted_at = now
        lasts = {topic: buffer.last for topic, buffer in self.buffers.items()}
        return {
            'heard': {
                topic: {
                    'rate': round(self._rates[topic], 1),
                    'age': None if last is None else round(now - last, 1),
                }
                for topic, last in lasts.items()
            },
            'model': self._spec or self._model_on_topic,
            'said': self._said(now),
            'faults': [
                f'{topic}: {one.fault}' for topic, one in self.buffers.items() if one.fault
            ],
        }

    def _said(self, now: float) -> list[str]:
        """Sentences on what is missing, the measurement first."""
        out = []
        silent = {topic: self._silence(topic, now) for topic in TOPICS}
        if silent['drive_supply']:
            out.append(f'{silent["drive_supply"]}: start `ros2 run wattwalk_bringup live`')
        if self._fault:
            out.append(self._fault)
        elif self._spec:
            topics = [] if self._session is None else sorted(self._session.required)
            out += [f'{silent[t]}: the model has no input' for t in topics if silent[t]]
            if len(out) == 0 and self._status is not Status.OK:
                out.append(f'model: {MESSAGES.get(self._status, "its input is stale")}')
        elif silent['power_estimate']:
            out.append(
                'no model: choose one here, or start '
                '`ros2 run power_estimator estimate --ros-args -p model:=FILE`'
            )
        return out

    def _silence(self, topic: str, now: float) -> str:
        last = self.buffers[topic].last
        since = now - (self._started if last is None else last)
        if since < _SILENT:
            return ''
        if last is None:
            return f'no {topic} heard for {since:.0f} s'
        return f'{topic} stopped {since:.0f} s ago'


def _content(rows: PowerRows | None) -> Mapping[str, Any]:
    if rows is None:
        return {'names': [], 't': [], 'measured': [], 'estimate': []}
    return {
        'names': list(rows.names),
        't': np.round(rows.stamp_ns / 1e9, 3).tolist(),
        'measured': finite(np.round(rows.measured.T, 3).tolist()),
        'estimate': finite(np.round(rows.estimate.T, 3).tolist()),
    }
