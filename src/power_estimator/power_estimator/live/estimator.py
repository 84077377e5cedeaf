"""Live estimates: causal sampling, carried state, and the status of an estimate."""

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated, Protocol

import numpy as np
from numpy.typing import NDArray
from power_recordings.alignment.dataset import AlignedDataset
from wattwalk_core.schema import Quantity, check_quantities

from power_estimator.model import PowerModel
from power_estimator.network.ppn import PowerPredictionNetwork

Floats = NDArray[np.float32]
Doubles = NDArray[np.float64]
_SIGNALS = ('position', 'velocity', 'torque', 'command')


class Status(IntEnum):
    """Status of an estimate, as in drive_power_msgs/PowerEstimate."""

    OK = 0
    WARMING_UP = 1
    INPUT_STALE = 2
    OUTSIDE_TRAINING_DATA = 3


@dataclass(frozen=True)
class LiveConfig:
    """Timing of the live estimate."""

    rate: Annotated[float, Quantity(10.0, 1000.0, 'Hz')] = 200.0  # of the model's input
    block: Annotated[int, Quantity(1, 100, 'samples')] = 4  # averaged into one estimate
    bridged: Annotated[int, Quantity(0, 20, 'samples')] = 2  # missing before the past is dropped
    command_timeout: Annotated[float, Quantity(0.01, 60.0, 's')] = 0.2  # until input is stale
    margin: Annotated[float, Quantity(0.0, 10.0)] = 0.05  # of a feature's range, outside of it

    def __post_init__(self) -> None:
        check_quantities(self)


@dataclass(frozen=True)
class LiveSample:
    """Signals of D drives at the model's rate."""

    stamp: int  # ns, of the newest joint state in it
    position: Doubles  # rad [D]
    velocity: Doubles  # rad/s [D]
    torque: Doubles  # N·m [D]
    command: Doubles  # rad [D], in force
    fresh: bool  # it does not follow the sample before


@dataclass(frozen=True)
class Estimate:
    """Mean power of D drives over the 20 ms (block / rate) that end at the stamp."""

    stamp: int  # ns, of the newest joint state in it
    power: Floats  # W [D]
    status: Status

    @property
    def total(self) -> float:
        """Return the sum over the known drives, W; NaN if there are none."""
        known = np.isfinite(self.power)
        return float(self.power[known].sum()) if known.any() else float('nan')


class CausalSampler:
    """
    Causal resampling of joint states at any rate to the model's rate.

    Time is cut into bins of 1/rate by the stamps. A sample is the mean of the joint states in its
    bin and is returned with the last of them, not with the first of the next bin. At 400 Hz that
    is the mean of two: a delay of 1.25 ms and −3 dB at 100 Hz. Up to `bridged` empty bins repeat
    the sample before them; after a longer gap, or a step back in time, the sample is fresh.
    """

    def __init__(self, config: LiveConfig) -> None:
        self._width = 1e9 / config.rate
        self._bridged = config.bridged
        self._origin: float | None = None
        self._bin = self._last_bin = 0
        self._period = 0.0
        self._stamp = 0
        self._sum: Doubles = np.zeros(0)
        self._count = 0
        self._previous: Doubles | None = None

    def add(self, stamp: int, signals: Doubles) -> Iterator[tuple[int, Doubles, bool]]:
        """Take one joint state, signals [4, D]; yield (stamp, mean [4, D], fresh) of full bins."""
        if self._origin is None:
            self._origin = stamp - self._width / 4
        else:
            step = stamp - self._stamp
            if -1e9 < step <= 0:
                return
            if step > 0:
                known = self._period or step
                self._period = known + 0.05 * max(-known / 2, min(step - known, known / 2))
        index = int((stamp - self._origin) // self._width)
        if index != self._bin and self._count:
            yield from self._close()
        self._bin, self._stamp = index, stamp
        self._sum = self._sum + signals if self._count else signals
        self._count += 1
        if self._period and (stamp + self._period - self._origin) // self._width != index:
            yield from self._close()

    def _close(self) -> Iterator[tuple[int, Doubles, bool]]:
        mean, missing = self._sum / self._count, self._bin - self._last_bin - 1
        self._count = 0
        if self._previous is not None and missing == -1:
            return
        fresh = self._previous is None or not 0 <= missing <= self._bridged
        if self._previous is not None and not fresh:
            for _ in range(missing):
                yield self._stamp, self._previous, False
        self._last_bin, self._previous = self._bin, mean
        yield self._stamp, mean, fresh


class EstimateStream(Protocol):
    """A power model that is fed block by block."""

    warm_up: int  # samples after a fresh one without an estimate

    def advance(self, samples: Sequence[LiveSample]) -> Floats:
        """Return the power in W [n, D] at the next n samples; NaN for unknown drives."""

    def outside(self, samples: Sequence[LiveSample], margin: float) -> bool:
        """Return whether a drive moves outside the training data."""


class NetworkStream:
    """The Power Prediction Network with carried state, all drives in one step."""

    def __init__(self, model: PowerPredictionNetwork, drives: Sequence[str]) -> None:
        self.warm_up = model.checkpoint.config.warm_up
        self._bank = model.stream(drives)
        self._low, self._high = model.range_of(drives)
        self._guard = model.guard(drives)

    def advance(self, samples: Sequence[LiveSample]) -> Floats:
        """Return the power in W [n, D]."""
        fresh = np.array([[s.fresh] * len(s.position) for s in samples])
        return self._bank.run(_features(samples), fresh)

    def outside(self, samples: Sequence[LiveSample], margin: float) -> bool:
        """
        Return whether the samples lie outside the training data.

        They do by a feature beyond its range by more than margin of that range, or by the
        out-of-distribution score of a block.
        """
        slack = margin * (self._high - self._low)
        x = _features(samples)
        beyond = (x < self._low - slack) | (x > self._high + slack)
        return bool(beyond.any() or self._guard.unlike(x).any())


class WindowStream:
    """Any other power model, run on the last half second at each estimate."""

    warm_up = 8

    def __init__(self, model: PowerModel, drives: Sequence[str], config: LiveConfig) -> None:
        self._model = model
        self._drives = tuple(drives)
        self._rate = config.rate
        self._window: deque[LiveSample] = deque(maxlen=max(config.block, round(config.rate / 2)))

    def advance(self, samples: Sequence[LiveSample]) -> Floats:
        """Return the power in W [n, D]."""
        for sample in samples:
            if sample.fresh:
                self._window.clear()
            self._window.append(sample)
        return self._model.predict(self._dataset())[-len(samples) :]

    def outside(self, samples: Sequence[LiveSample], margin: float) -> bool:
        """Return False: such models have no training data."""
        return False

    def _dataset(self) -> AlignedDataset:
        samples = list(self._window)
        return AlignedDataset.blank(
            self._rate,
            self._drives,
            np.arange(len(samples)) / self._rate,
            'live',
            **{name: np.array([getattr(s, name) for s in samples]) for name in _SIGNALS},
        )


class LiveEstimator:
    """
    Joint states and commands in, estimates at rate/block (50 Hz) out.

    A command holds from its stamp until the next one. Without targets (the drives are damped)
    there is no estimate. Joint states with a NaN are left out.
    """

    def __init__(
        self, model: PowerModel, drives: Sequence[str], config: LiveConfig | None = None
    ) -> None:
        config = config or LiveConfig()
        self.drives = tuple(drives)
        self.refused = 0
        self._config = config
        self._stream: EstimateStream = (
            NetworkStream(model, drives)
            if isinstance(model, PowerPredictionNetwork)
            else WindowStream(model, drives, config)
        )
        self._sampler = CausalSampler(config)
        self._waiting: deque[tuple[int, Doubles]] = deque(maxlen=1000)
        self._command: tuple[int, Doubles] | None = None
        self._block: list[LiveSample] = []
        self._since_fresh = 0

    def command(self, stamp: int, position: Doubles) -> None:
        """Take position targets [D] in rad, NaN for none, that hold from stamp (ns) on."""
        while self._waiting and stamp < self._waiting[-1][0]:
            self._waiting.pop()
        self._waiting.append((stamp, position))

    def joint_state(
        self, stamp: int, position: Doubles, velocity: Doubles, torque: Doubles
    ) -> Estimate | None:
        """Take a joint state [D] of stamp (ns); return an estimate when one is due."""
        while self._waiting and self._waiting[0][0] <= stamp:
            self._command = self._waiting.popleft()
        if self._command is None:
            return None
        signals = np.array((position, velocity, torque, self._command[1]))
        if not np.isfinite(signals).all():
            self.refused += 1
            return None
        result = None
        for when, (at, rate, load, target), fresh in self._sampler.add(stamp, signals):
            result = self._advance(LiveSample(when, at, rate, load, target, fresh)) or result
        return result

    def _advance(self, sample: LiveSample) -> Estimate | None:
        if sample.fresh:
            self._block.clear()
            self._since_fresh = 0
        self._block.append(sample)
        self._since_fresh += 1
        if len(self._block) < self._config.block:
            return None
        power = self._stream.advance(self._block).mean(axis=0)
        outside = self._stream.outside(self._block, self._config.margin)
        self._block = []
        return Estimate(sample.stamp, power, self._status(sample.stamp, outside))

    def _status(self, stamp: int, outside: bool) -> Status:
        assert self._command is not None
        if stamp - self._command[0] > self._config.command_timeout * 1e9:
            return Status.INPUT_STALE
        if self._since_fresh < self._stream.warm_up + self._config.block:
            return Status.WARMING_UP
        return Status.OUTSIDE_TRAINING_DATA if outside else Status.OK


def _features(samples: Sequence[LiveSample]) -> Floats:
    return np.array(
        [np.stack([s.command - s.position, s.torque, s.velocity], axis=1) for s in samples],
        np.float32,
    )
