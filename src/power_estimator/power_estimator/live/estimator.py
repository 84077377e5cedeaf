"""Live estimates: joint states, targets and supply in, power and its status out."""

import math
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from enum import IntEnum
from typing import Annotated, Any, Final, NamedTuple

import numpy as np
from power_recordings.alignment.dataset import AlignedDataset
from wattwalk_core.arrays import Floats, Singles
from wattwalk_core.errors import InputError
from wattwalk_core.schema import CheckedFields, Quantity

from power_estimator.effects.model_file.model import EffectModel
from power_estimator.effects.signals.state import Carried
from power_estimator.effects.split import SHAFT
from power_estimator.model import Needs, PowerModel
from power_estimator.network.features import features
from power_estimator.network.ppn import PowerPredictionNetwork

_BESIDE_CARRIED: Final = 0.1  # s, more than derivatives and springs look back
LOSSES: Final = 'losses'
"""Part of a model that does not say which: its power less that of the shaft."""
_MARGIN: Final = 0.05  # of a feature's range, outside of it
_SETTLED: Final = 0.05  # share of a carried state that may stem from before the first sample


class NetworkStream:
    """Power Prediction Network on blocks of samples, with the state carried between them.

    Samples at a multiple of its rate are averaged, and its estimates held.
    """

    settled = True

    def __init__(self, model: PowerPredictionNetwork, drives: Sequence[str], rate: float) -> None:
        config = model.checkpoint.config
        self._times = round(rate / config.rate)
        self.warm_up = config.warm_up * self._times
        self._bank = model.stream(drives)
        self._low, self._high = model.range_of(drives)
        self._guard = model.guard(drives)
        self.parts: Mapping[str, Floats] = {}
        self._segment = -1
        self._seen: Singles = np.zeros((0, len(drives), 3), np.float32)

    def advance(self, block: AlignedDataset) -> Singles:
        """Return the power in W [n, D] of the next block of n samples."""
        x = features(block)
        if self._times > 1:
            x = x.reshape(-1, self._times, *x.shape[1:]).mean(axis=1)
        fresh = np.zeros(x.shape[:2], bool)
        fresh[0] = block.segment[0] != self._segment
        self._segment, self._seen = int(block.segment[-1]), x
        return np.repeat(self._bank.run(x, fresh), self._times, axis=0)

    def outside(self) -> bool:
        """Return whether the last block lies outside the training data.

        It does by a feature beyond its range by more than 5 % of that range, or by its
        out-of-distribution score.
        """
        slack = _MARGIN * (self._high - self._low)
        beyond = (self._seen < self._low - slack) | (self._seen > self._high + slack)
        return bool(beyond.any() or self._guard.unlike(self._seen).any())


class WindowStream:
    """Power model that is run on each block and the samples before it that it needs.

    parts: mean power of the last block by effect, W [D], of models that are made of effects.
    InputError for a memory that cannot be carried.
    """

    settled = True

    def __init__(self, model: PowerModel, needs: Needs, rate: float) -> None:
        if math.isinf(needs.memory) and not needs.carried:
            raise InputError(
                f'{model.name}: {needs.remembers} follows all samples before, and cannot be '
                'carried from one estimate to the next'
            )
        memory = _BESIDE_CARRIED if math.isinf(needs.memory) else needs.memory
        self.warm_up = self._rows = max(1, math.ceil(memory * rate))
        self.parts: Mapping[str, Floats] = {}
        self._model = model
        self._window: AlignedDataset | None = None

    def advance(self, block: AlignedDataset) -> Singles:
        """Return the power in W [n, D] of the next block of n samples."""
        return self._model.predict(self._with_past(block))[-len(block.time) :]

    def outside(self) -> bool:
        """Return False: such models have no training data."""
        return False

    def _with_past(self, block: AlignedDataset) -> AlignedDataset:
        before = self._window
        if before is not None and before.segment[-1] == block.segment[0]:
            block = _joined(before.rows(slice(-self._rows, None)), block)
        self._window = block
        return block


class EffectStream(WindowStream):
    """Model of effects on blocks; the memory of effects and of the base model is carried."""

    def __init__(self, model: EffectModel, drives: Sequence[str], rate: float) -> None:
        self._effects = replace(model, base=None, base_model=None)
        super().__init__(self._effects, self._effects.needs_in(drives), rate)
        base = model.base_model
        self._base = None if base is None else stream_of(base, drives, rate)
        if self._base is not None:
            self.warm_up = max(self.warm_up, self._base.warm_up)
        self._carried = Carried()

    @property
    def settled(self) -> bool:  # type: ignore[override]
        """True once what was before the first sample no longer matters."""
        return self._carried.unknown < _SETTLED

    def advance(self, block: AlignedDataset) -> Singles:
        """Return the power in W [n, D] of the next block; `parts` has its mean by effect."""
        if self._base is not None:
            block = replace(block, extras={'base': self._base.advance(block)})
        window, count = self._with_past(block), len(block.time)
        base = window.extras.get('base')
        found = self._effects.by_part(window, base=base, carried=self._carried)
        if not found:
            self.parts = {}
            return np.full(block.torque.shape, np.nan, np.float32)
        parts = np.stack([values[-count:] for values in found.values()])
        self.parts = dict(zip(found, parts.mean(axis=1), strict=True))
        return parts.sum(axis=0).astype(np.float32)

    def outside(self) -> bool:
        """Return whether the base model finds the last block outside its training data."""
        return self._base is not None and self._base.outside()


def stream_of(
    model: PowerModel, drives: Sequence[str], rate: float
) -> NetworkStream | WindowStream:
    """Return an evaluator of the model that takes its samples block by block; rate: Hz.

    InputError for a model whose memory of earlier samples cannot be carried between blocks.
    """
    if isinstance(model, PowerPredictionNetwork):
        return NetworkStream(model, drives, rate)
    if isinstance(model, EffectModel):
        return EffectStream(model, drives, rate)
    return WindowStream(model, model.needs, rate)


def _joined(before: AlignedDataset, block: AlignedDataset) -> AlignedDataset:
    """A block behind the samples before it, of the same segment and recording."""
    arrays: dict[str, Any] = {
        f.name: np.concatenate([getattr(before, f.name), getattr(block, f.name)])
        for f in fields(block)
        if isinstance(getattr(block, f.name), np.ndarray)
    }
    extras = {
        name: np.concatenate([before.extras[name], values])
        for name, values in block.extras.items()
    }
    return replace(block, **arrays, extras=extras)


_AHEAD: Final = 1.25e6  # ns, half the time between joint states at 400 Hz
_BRIDGED: Final = 0.01  # s of missing joint states before the past is dropped


class LiveSample(NamedTuple):
    """Mean signals of D drives in one bin of 1/rate s, as they enter a live estimate."""

    stamp: int  # ns, of the newest joint state in it
    signals: Floats  # in SI units [S, D]
    fresh: bool  # it does not follow the sample before


class CausalSampler:
    """Means of the joint states in successive bins of 1/rate s; rate in Hz.

    A sample is returned with the last joint state in its bin, not with the first of the next bin.
    At 400 Hz in and 200 Hz out that is the mean of two: a delay of 1.25 ms and −3 dB at 100 Hz. Up
    to 10 ms of empty bins are interpolated; after a longer gap, or a step back in time, the sample
    is fresh.
    """

    def __init__(self, rate: float) -> None:
        self._width = 1e9 / rate
        self._bridged = round(_BRIDGED * rate)
        self._origin: float | None = None
        self._bin = self._last_bin = 0
        self._period = 0.0
        self._stamp = 0
        self._sum: Floats = np.zeros(0)
        self._count = 0
        self._previous: tuple[int, Floats] | None = None

    def add(self, stamp: int, signals: Floats) -> Iterator[LiveSample]:
        """Take a joint state [S, D] at a stamp in ns; yield the samples of full bins."""
        if self._origin is None:
            self._origin = stamp - _AHEAD
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

    def _close(self) -> Iterator[LiveSample]:
        mean, missing = self._sum / self._count, self._bin - self._last_bin - 1
        self._count = 0
        if self._previous is not None and missing == -1:
            return
        fresh = self._previous is None or not 0 <= missing <= self._bridged
        if self._previous is not None and not fresh:
            stamp, before = self._previous
            for share in np.arange(1, missing + 1) / (missing + 1):
                between = round(stamp + share * (self._stamp - stamp))
                yield LiveSample(between, before + share * (mean - before), False)
        self._last_bin, self._previous = self._bin, (self._stamp, mean)
        yield LiveSample(self._stamp, mean, fresh)


_SIGNALS: Final = ('position', 'velocity', 'torque', 'command', 'voltage', 'temperature')
_KNOWN: Final = ('position_error', 'position', 'velocity', 'torque', 'voltage', 'temperature')


class Status(IntEnum):
    """Status of an estimate, as in drive_power_msgs/PowerEstimate."""

    OK = 0
    WARMING_UP = 1
    INPUT_STALE = 2
    OUTSIDE_TRAINING_DATA = 3


@dataclass(frozen=True)
class LiveConfig(CheckedFields):
    """Timing of the live estimate."""

    period: Annotated[float, Quantity(0.005, 1.0, 's')] = 0.02  # between estimates
    command_timeout: Annotated[float, Quantity(0.01, 60.0, 's')] = 0.2  # until input is stale


@dataclass(frozen=True)
class Estimate:
    """Mean power of D drives over the 20 ms (LiveConfig.period) that end at the stamp."""

    stamp: int  # ns, of the newest joint state in it
    power: Singles  # W [D]
    status: Status
    parts: Mapping[str, Floats] = field(default_factory=dict)  # of the power, W [D]

    @property
    def total(self) -> float:
        """Sum over the drives with an estimate, W; NaN if there are none."""
        known = np.isfinite(self.power)
        return float(self.power[known].sum()) if known.any() else float('nan')


class LiveEstimator:
    """Live estimates at 50 Hz from joint states and what else the model needs.

    A command holds from its stamp until the next one, a supply's voltage and temperature until the
    next. Of a model that needs targets there is no estimate without them (the drives are damped).
    Joint states with a NaN in what the model needs are counted in `refused` and left out.
    """

    def __init__(
        self, model: PowerModel, drives: Sequence[str], config: LiveConfig | None = None
    ) -> None:
        """Raise InputError for a model that cannot be estimated live, saying why."""
        self.drives = tuple(drives)
        self.refused = 0
        self._config = config or LiveConfig()
        self._model, needs = model, model.needs
        lacking = needs.lacking(_KNOWN)
        if lacking:
            raise InputError(f'{model.name}: {lacking}, which no topic brings')
        self._rate = needs.rate
        self._block_size = max(1, round(self._config.period * needs.rate))
        self._targets = 'position_error' in needs.inputs
        inputs = {*needs.inputs, *(('position', 'command') if self._targets else ())}
        needed = [name for name in _SIGNALS if name in inputs]
        self._needed = len(needed)
        self._signals = (*needed, *(set(needs.improved_by) - inputs))
        self._rows = [_SIGNALS.index(name) for name in self._signals]
        self._stream = stream_of(model, drives, needs.rate)
        self._sampler = CausalSampler(needs.rate)
        self._waiting: deque[tuple[int, Floats]] = deque(maxlen=1000)
        self._command: tuple[int, Floats] | None = None
        self._unknown = np.full(len(self.drives), np.nan)
        self._supply = np.stack([self._unknown, self._unknown])
        self._block: list[LiveSample] = []
        self._since_fresh = self._segment = 0
        self._origin = self._newest = 0

    def command(self, stamp: int, position: Floats) -> None:
        """Take position targets [D] in rad, NaN for none, that hold from stamp (ns) on."""
        while self._waiting and stamp < self._waiting[-1][0]:
            self._waiting.pop()
        self._waiting.append((stamp, position))

    def supply(self, voltage: Floats, temperature: Floats) -> None:
        """Take the drives' voltage in V and winding temperature in °C [D], NaN where unknown."""
        self._supply = np.stack([voltage, temperature])

    def joint_state(
        self, stamp: int, position: Floats, velocity: Floats, torque: Floats
    ) -> Estimate | None:
        """Take position (rad), velocity (rad/s) and torque (N·m) [D] at a stamp in ns.

        Returns an estimate when one is due, else None.
        """
        while self._waiting and self._waiting[0][0] <= stamp:
            self._command = self._waiting.popleft()
        if self._targets and self._command is None:
            return None
        target = self._unknown if self._command is None else self._command[1]
        known = (position, velocity, torque, target, *self._supply)
        signals = np.array([known[row] for row in self._rows])
        if not np.isfinite(signals[: self._needed]).all():
            self.refused += 1
            return None
        result = None
        for sample in self._sampler.add(stamp, signals):
            result = self._advance(sample) or result
        return result

    def _advance(self, sample: LiveSample) -> Estimate | None:
        if sample.fresh:
            if not self._segment or sample.stamp < self._newest:
                self._stream = stream_of(self._model, self.drives, self._rate)
                self._origin = sample.stamp
            self._block.clear()
            self._since_fresh = 0
            self._segment += 1
        self._block.append(sample)
        self._newest = sample.stamp
        self._since_fresh += 1
        if len(self._block) < self._block_size:
            return None
        block = self._dataset()
        power = self._stream.advance(block).mean(axis=0)
        parts = self._stream.parts
        if not parts and {'torque', 'velocity'} <= {*self._signals}:
            shaft = (block.torque * block.velocity).mean(axis=0, dtype=np.float64)
            parts = {SHAFT: shaft, LOSSES: power - shaft}
        self._block = []
        return Estimate(sample.stamp, power, self._status(sample.stamp), parts)

    def _dataset(self) -> AlignedDataset:
        stamps = np.array([sample.stamp for sample in self._block])
        rows = np.stack([sample.signals for sample in self._block], axis=1)
        signals = dict(zip(self._signals, rows, strict=True))
        time = (stamps - self._origin) / 1e9
        block = AlignedDataset.blank(self._rate, self.drives, time, 'live', **signals)
        block.segment[:] = self._segment
        return block

    def _status(self, stamp: int) -> Status:
        held = stamp - self._command[0] if self._targets and self._command else 0
        if held > self._config.command_timeout * 1e9:
            return Status.INPUT_STALE
        if self._since_fresh < self._stream.warm_up + self._block_size or not self._stream.settled:
            return Status.WARMING_UP
        return Status.OUTSIDE_TRAINING_DATA if self._stream.outside() else Status.OK
