"""Messages, estimates and diagnostics of the live node, without ROS."""

from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError

from power_estimator.live.budget import LiveBudget
from power_estimator.live.change_watch import ChangeWatch, ReferenceNoise, Shift, WatchConfig
from power_estimator.live.estimator import Estimate, LiveConfig, LiveEstimator, Status
from power_estimator.live.score import LiveScore
from power_estimator.model import PowerModel
from power_estimator.network.ppn import PowerPredictionNetwork

_SECOND = 1_000_000_000  # ns
_LEAST_ESTIMATES = 0.8  # of a second's
_LEAST_SAMPLES = 20  # of the measured power
_MOST_WAITING = 10  # seconds that are not complete
_NOTHING = (np.zeros(()), 0)


class SecondMeans:
    """Means over each second of D drives, once all streams have passed it."""

    def __init__(self, rate: float) -> None:
        """rate: estimates per second."""
        self._rate = rate
        self._sums: dict[int, dict[str, tuple[Floats, int]]] = {}  # and counts, by second
        self._newest = {'measured': -1, 'moved': -1, 'estimated': -1}

    def measured(self, stamp: int, power: Floats) -> None:
        """Take measured power W [samples, D], without NaN, at a stamp (ns)."""
        self._add('measured', stamp, power.sum(axis=0), len(power))

    def moved(self, stamp: int, velocity: Floats, torque: Floats) -> None:
        """Take speed in rad/s and torque in N·m, [D], at a stamp (ns)."""
        self._add('moved', stamp, np.stack([np.abs(velocity), velocity**2, torque**2], axis=1))

    def estimated(self, stamp: int, power: Floats) -> None:
        """Take a reliable estimate W [D] at a stamp (ns)."""
        self._add('estimated', stamp, power)

    def complete(self) -> Iterator[tuple[int, Floats, Floats]]:
        """Yield each complete second's arguments for `ChangeWatch.second`, once."""
        for index in sorted(i for i in self._sums if i < self._passed):
            sums = self._sums.pop(index)
            power, samples = sums.get('measured', _NOTHING)
            motion, states = sums.get('moved', _NOTHING)
            estimate, estimates = sums.get('estimated', _NOTHING)
            enough = estimates >= _LEAST_ESTIMATES * self._rate and states
            if samples >= _LEAST_SAMPLES and enough:
                mean = estimate / estimates
                regressors = np.column_stack([np.ones(len(mean)), motion / states, mean])
                yield index, power / samples - mean, regressors

    @property
    def _passed(self) -> int:
        return min(self._newest['measured'], self._newest['estimated'])

    def _add(self, kind: str, stamp: int, values: Floats, count: int = 1) -> None:
        """Add to the sums of a stamp's second; nothing for one that is long past."""
        index = stamp // _SECOND
        if index not in self._sums and index <= self._passed - _MOST_WAITING:
            return
        sums = self._sums.setdefault(index, {})
        total, known = sums.get(kind, _NOTHING)
        sums[kind] = (total + values, known + count)
        self._newest[kind] = max(self._newest[kind], index)
        if len(self._sums) > _MOST_WAITING:
            del self._sums[min(self._sums)]


MESSAGES = {
    Status.OK: 'estimating',
    Status.WARMING_UP: 'warming up',
    Status.OUTSIDE_TRAINING_DATA: 'the robot moves as it never did in the training data',
}
_TOPICS = {
    'position_error': 'joint_commands',
    'voltage': 'drive_supply',
    'temperature': 'drive_supply',
}
"""Topics of inputs; the others come in joint_states."""


def topics_of(inputs: Iterable[str]) -> set[str]:
    """Return the names of the topics that bring these inputs of a model."""
    return {_TOPICS.get(name, 'joint_states') for name in inputs}


@dataclass(frozen=True)
class Vector:
    """Rows of values by name, at a stamp, as a message has them."""

    stamp: int  # ns
    names: tuple[str, ...]
    values: Floats  # [rows, names]


@lru_cache
def _columns(names: tuple[str, ...], drives: tuple[str, ...]) -> list[int] | None:
    """Columns of the drives among the names of a message, in any order; None if one is missing."""
    return [names.index(drive) for drive in drives] if {*drives} <= {*names} else None


class LiveSession:
    """Estimates and their diagnostics from messages with names in any order.

    The drives are those of joint_states (and of joint_commands, for a model that needs targets)
    that the model knows and that are `wanted` (all if empty). Times of arrival are in s on a
    steady clock. Messages that the model does not need are left out.
    """

    def __init__(
        self,
        model: PowerModel,
        *,
        wanted: Sequence[str] = (),
        stale_after: float = 0.1,
        config: LiveConfig | None = None,
        watch: WatchConfig | None = None,
        reference: Mapping[str, ReferenceNoise] | None = None,
    ) -> None:
        """stale_after: s without joint states or estimates until the input is stale.

        watch: settings for a comparison with `reference`, which is learned unless it is given;
        None for no comparison.
        """
        self._watch_config, self._reference = watch, reference
        self.watch: ChangeWatch | None = None
        self._seconds: SecondMeans | None = None
        self._model = model
        self.topics = topics_of((*model.needs.inputs, *model.needs.improved_by))
        self.required = topics_of(model.needs.inputs) | {'joint_states'}
        self._wanted = tuple(wanted)
        self._config = config or LiveConfig()
        self._stale_after = stale_after
        self._live: LiveEstimator | None = None
        self._first_command: Vector | None = None
        topics = ('joint_states', *sorted(self.topics - {'joint_states'}))
        self._arrived = dict.fromkeys(topics, -np.inf)
        self._counts = dict.fromkeys((*self._arrived, 'power_estimate'), 0)
        self._ages: deque[float] = deque(maxlen=1000)
        self._score = LiveScore(self._config.period)
        self.budget = LiveBudget()
        self._estimated = -np.inf
        self._last: Estimate | None = None
        self._unknown = 0
        self._left_out = 0

    @property
    def model(self) -> str:
        """Name of the power model."""
        return self._model.name

    @property
    def drives(self) -> tuple[str, ...]:
        """Names of the estimated drives; empty until the required topics have been received."""
        return () if self._live is None else self._live.drives

    def command(self, command: Vector, arrival: float) -> None:
        """Take position targets [1, names] in rad, NaN for none; arrival: s."""
        if 'joint_commands' not in self.topics:
            return
        self._hear('joint_commands', arrival)
        if self._live is None:
            self._first_command = command
            return
        found = self._of_drives(command)
        if found is None:
            self._unknown += 1
        else:
            self._live.command(command.stamp, found[0])

    def joint_state(self, state: Vector, arrival: float) -> Estimate | None:
        """Take position, velocity, torque [3, names] in SI; return an estimate if one is due."""
        self._hear('joint_states', arrival)
        live = self._live or self._begin(state, arrival)
        if live is None:
            return None
        found = self._of_drives(state)
        if found is None:
            self._unknown += 1
            return None
        if self._seconds is not None and np.isfinite(found).all():
            self._seconds.moved(state.stamp, found[1], found[2])
        estimate = live.joint_state(state.stamp, *found)
        if estimate is None:
            return None
        self._estimated = arrival
        if self._seconds is not None and estimate.status is Status.OK:
            self._seconds.estimated(estimate.stamp, estimate.power.astype(float))
        return self._say(estimate)

    def electrical(self, supply: Vector, arrival: float) -> None:
        """Take voltage in V and winding temperature in °C [2, names], NaN where unknown."""
        if 'drive_supply' not in self.topics:
            return
        self._hear('drive_supply', arrival)
        found = self._of_drives(supply)
        if self._live is not None and found is not None:
            self._live.supply(*found)

    def supply(self, measured: Vector) -> None:
        """Take the measured power of drives [samples, names] in W, to be compared with.

        Samples with a NaN in one of the estimated drives are left out.
        """
        found = self._of_drives(measured)
        if self._live is None or found is None:
            return
        good = found[np.isfinite(found).all(axis=1)]
        self._left_out += len(found) - len(good)
        if len(good):
            if self._seconds is not None:
                self._seconds.measured(measured.stamp, good)
            self._score.measured(measured.stamp, float(good.sum(axis=1).mean()))

    def watched(self) -> Shift | None:
        """Test the seconds that are complete; return a shift when it is found, else None."""
        found = None
        if self.watch is not None and self._seconds is not None:
            for second in self._seconds.complete():
                found = self.watch.second(*second) or found
        return found

    def stale(self, now: float) -> Estimate | None:
        """Return an empty estimate (NaN, INPUT_STALE) if none was made for `stale_after` s."""
        if self._live is None or now - self._estimated <= self._stale_after:
            return None
        stamp = self._last.stamp if self._last else 0
        unknown = np.full(len(self.drives), np.nan, np.float32)
        return self._say(Estimate(stamp, unknown, Status.INPUT_STALE))

    def sent(self, age: float) -> None:
        """Take the age (s) of the newest joint state of an estimate when it was sent."""
        self._ages.append(age)

    def report(self, now: float) -> tuple[bool, str, dict[str, str]]:
        """Return whether all is well, a sentence, and figures as text since the last report."""
        counts, self._counts = self._counts, dict.fromkeys(self._counts, 0)
        status = self._last.status if self._last else Status.WARMING_UP
        sentence = MESSAGES.get(status, '')
        for topic, arrived in self._arrived.items():
            if arrived == -np.inf and topic in self.required:
                status = Status.INPUT_STALE
                sentence = f'waiting for {topic}{self._reason(topic)}'
            elif now - arrived > self._stale_after and topic == 'joint_states':
                status, sentence = Status.INPUT_STALE, f'{topic} have stopped'
        if not sentence and 'joint_commands' in self.required:
            sentence = 'joint_commands are stale or have no targets'
        elif not sentence:
            sentence = f'the topics do not bring all of {", ".join(self._model.needs.inputs)}'
        figures = {
            'model': self._model.name,
            'drives': ' '.join(self.drives),
            **{
                f'age of {topic}': f'{now - arrived:.2f} s'
                for topic, arrived in self._arrived.items()
                if arrived > -np.inf
            },
            **{f'{topic} in the last report': str(n) for topic, n in counts.items()},
            'refused joint states': str(self._live.refused if self._live else 0),
            'messages without the drives': str(self._unknown),
        }
        if self._ages:
            figures['age p99'] = f'{1e3 * np.percentile(list(self._ages), 99):.2f} ms'
        if self._last:
            figures['total'] = f'{self._last.total:.1f} W'
        if self._left_out:
            figures['flagged supply samples left out'] = str(self._left_out)
        figures |= self._score.figures()
        return status in (Status.OK, Status.WARMING_UP), sentence, figures

    def _reason(self, topic: str) -> str:
        for name, effect in self._model.needs.inputs.items():
            if _TOPICS.get(name) == topic:
                return f': {effect or self._model.name} needs {name.replace("_", " ")}'
        return ''

    def _of_drives(self, vector: Vector) -> Floats | None:
        """Values [rows, D] of the estimated drives; None if one is missing."""
        columns = _columns(vector.names, self.drives)
        return None if columns is None else vector.values[:, columns]

    def _hear(self, topic: str, arrival: float) -> None:
        self._arrived[topic] = arrival
        self._counts[topic] += 1

    def _begin(self, state: Vector, arrival: float) -> LiveEstimator | None:
        command = self._first_command
        if command is None and 'joint_commands' in self.required:
            return None
        missing = [name for name in self._wanted if name not in state.names]
        if missing:
            raise InputError(
                f'drives names {missing[0]!r}, joint_states has {", ".join(state.names)}'
            )
        together = self._model.needs.together
        if together and self._wanted and set(state.names) - set(self._wanted):
            raise InputError(
                f'{self._model.name}: {together} looks at all drives of the bus at once; give no '
                '`drives`'
            )
        drives = [
            name
            for name in self._wanted or state.names
            if command is None or name in command.names
        ]
        if isinstance(self._model, PowerPredictionNetwork):
            types = self._model.types
            drives = [name for name in drives if any(kind.matches(name) for kind in types)]
        if not drives:
            raise InputError(
                f'{self._model.name} knows none of the joints that '
                f'{" and ".join(sorted(self.required))} share ({", ".join(state.names)})'
            )
        self._live = LiveEstimator(self._model, drives, self._config)
        self._estimated = arrival
        if self._watch_config is not None:
            self.watch = ChangeWatch(drives, self._watch_config, self._reference)
            self._seconds = SecondMeans(1 / self._config.period)
        if command is not None:
            found = self._of_drives(command)
            if found is not None:
                self._live.command(command.stamp, found[0])
        return self._live

    def _say(self, estimate: Estimate) -> Estimate:
        self._counts['power_estimate'] += 1
        self._last = estimate
        self.budget.take(estimate)
        self._score.estimated(estimate.stamp, estimate.total)
        return estimate
