"""Power models that are fed block by block and keep what they need of the past."""

import math
from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray
from power_recordings.alignment.dataset import AlignedDataset
from wattwalk_core.errors import InputError

from power_estimator.effects.model_file.model import EffectModel
from power_estimator.effects.signals.carried import Carried
from power_estimator.model import Needs, PowerModel
from power_estimator.network.features import features
from power_estimator.network.ppn import PowerPredictionNetwork

Floats = NDArray[np.float32]
_BESIDE_CARRIED: Final = 0.1  # s, more than derivatives and springs look back
_SETTLED: Final = 0.05  # share of a carried state that may stem from before the first sample


class EstimateStream(Protocol):
    """A power model with its past."""

    warm_up: int  # samples of a stretch without an estimate

    def advance(self, block: AlignedDataset) -> Floats:
        """Return the power in W [n, D] at the next n samples; NaN for unknown drives."""

    def outside(self, margin: float) -> bool:
        """Return whether the last block lies outside the training data."""

    @property
    def settled(self) -> bool:
        """Return whether what was before the first sample no longer matters."""


def stream_of(model: PowerModel, drives: Sequence[str], rate: float) -> EstimateStream:
    """Return the model as a stream of samples at this rate; InputError if it cannot be one."""
    if isinstance(model, PowerPredictionNetwork):
        return NetworkStream(model, drives, rate)
    if isinstance(model, EffectModel):
        return EffectStream(model, drives, rate)
    return WindowStream(model, model.needs, rate)


class NetworkStream:
    """
    The Power Prediction Network with carried state, all drives in one step.

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
        self._segment = -1
        self._seen: Floats = np.zeros((0, len(drives), 3), np.float32)

    def advance(self, block: AlignedDataset) -> Floats:
        """Return the power in W [n, D]."""
        x = features(block)
        if self._times > 1:
            x = x.reshape(-1, self._times, *x.shape[1:]).mean(axis=1)
        fresh = np.zeros(x.shape[:2], bool)
        fresh[0] = block.segment[0] != self._segment
        self._segment, self._seen = int(block.segment[-1]), x
        return np.repeat(self._bank.run(x, fresh), self._times, axis=0)

    def outside(self, margin: float) -> bool:
        """
        Return whether the last block lies outside the training data.

        It does by a feature beyond its range by more than margin of that range, or by its
        out-of-distribution score.
        """
        slack = margin * (self._high - self._low)
        beyond = (self._seen < self._low - slack) | (self._seen > self._high + slack)
        return bool(beyond.any() or self._guard.unlike(self._seen).any())


class WindowStream:
    """A power model that is run on each block and the samples before it that it needs."""

    settled = True

    def __init__(self, model: PowerModel, needs: Needs, rate: float) -> None:
        if math.isinf(needs.memory) and not needs.carried:
            raise InputError(
                f'{model.name}: {needs.remembers} follows all samples before, and cannot be '
                'carried from one estimate to the next'
            )
        memory = _BESIDE_CARRIED if math.isinf(needs.memory) else needs.memory
        self.warm_up = self._rows = max(1, math.ceil(memory * rate))
        self._model = model
        self._window: AlignedDataset | None = None

    def advance(self, block: AlignedDataset) -> Floats:
        """Return the power in W [n, D]."""
        return self._model.predict(self._with_past(block))[-len(block.time) :]

    def outside(self, margin: float) -> bool:
        """Return False: such models have no training data."""
        return False

    def _with_past(self, block: AlignedDataset) -> AlignedDataset:
        before = self._window
        if before is not None and before.segment[-1] == block.segment[0]:
            block = _joined(before.rows(slice(-self._rows, None)), block)
        self._window = block
        return block


class EffectStream(WindowStream):
    """A model of effects: the memory of its effects and of its base model is carried."""

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
        """Return whether what was before the first sample no longer matters."""
        return self._carried.unknown < _SETTLED

    def advance(self, block: AlignedDataset) -> Floats:
        """Return the power in W [n, D]."""
        if self._base is not None:
            block = replace(block, extras={'base': self._base.advance(block)})
        window = self._with_past(block)
        power = self._effects.predict(
            window, base=window.extras.get('base'), carried=self._carried
        )
        return power[-len(block.time) :]

    def outside(self, margin: float) -> bool:
        """Return whether the base model finds the last block outside its training data."""
        return self._base is not None and self._base.outside(margin)


def _joined(before: AlignedDataset, block: AlignedDataset) -> AlignedDataset:
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
