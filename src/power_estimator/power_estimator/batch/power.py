"""Power of many simulated robots side by side, for rewards in training."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from wattwalk_core.errors import InputError

from power_estimator.batch.effects import EffectBatch, ProxyBatch
from power_estimator.drive_types import assign
from power_estimator.effects.model_file.model import EffectModel
from power_estimator.loader import load_model
from power_estimator.model import PowerModel
from power_estimator.network.ppn import PowerPredictionNetwork
from power_estimator.portable.export import in_si_units
from power_estimator.portable.power_term import DriveTypeLstm
from power_estimator.proxies import Proxy

Array = NDArray[np.float32] | Tensor


class Advance(Protocol):
    """A power model with the state of each robot."""

    warm_up: int  # samples after a reset without a reliable estimate

    def reset(self, robots: Tensor | None) -> None:
        """Forget the past of the robots [n], or of all."""

    def advance(self, error: Tensor, torque: Tensor, speed: Tensor) -> Tensor:
        """Return the mean power in W [N, D] over S samples [N, S, D]."""


class BatchPower:
    """
    A stateful power model over N robots with D drives each.

    With a network one policy step of 20 ms is one call with S = 4 samples at 200 Hz; the state is
    carried from call to call and dropped robot by robot with `reset`. `ready` says whose estimate
    is reliable: not during the warm-up after a reset, where a reward should leave it out.
    Runs on the CPU with as many threads as torch is set to, and gives no gradient.
    """

    def __init__(self, model: PowerModel, drives: Sequence[str], robots: int) -> None:
        """Raise InputError for a model that lacks a drive or cannot be run step by step."""
        if robots < 1:
            raise InputError(f'robots = {robots} is not 1 or more')
        self.drives = tuple(drives)
        self.robots = robots
        self._model = _advance(model, self.drives, robots)
        self._since = np.zeros(robots, np.int64)
        self._lost = torch.zeros(robots, dtype=torch.bool)  # a NaN since the last reset

    @classmethod
    def load(cls, spec: str, drives: Sequence[str], robots: int) -> 'BatchPower':
        """Load `ppn:RUN` or a model file, as `load_model` finds them."""
        return cls(load_model(spec), drives, robots)

    @property
    def ready(self) -> NDArray[np.bool_]:
        """Mark the robots [N] whose estimate is past its warm-up."""
        return self._since > self._model.warm_up

    def reset(self, ids: Sequence[int] | NDArray[np.integer] | Tensor | None = None) -> None:
        """Forget the past of the robots with these numbers, or of all."""
        robots = None if ids is None else torch.as_tensor(ids, dtype=torch.long)
        if robots is not None and not len(robots):
            return
        with torch.inference_mode():
            self._model.reset(robots)
        self._since[slice(None) if robots is None else robots.numpy()] = 0
        self._lost[slice(None) if robots is None else robots] = False

    def step(self, position_error: Array, torque: Array, speed: Array) -> Array:
        """
        Return the mean power in W [N, D] of the next samples, [N, S, D] in rad, N·m and rad/s.

        [N, D] stands for S = 1. Tensors give a tensor, arrays an array. ValueError for another
        shape; robots with a NaN among their samples get NaN until they are reset.
        """
        given = [torch.as_tensor(x, dtype=torch.float32) for x in (position_error, torque, speed)]
        error, load, rate = (x[:, None] if x.ndim == 2 else x for x in given)
        shape = (self.robots, error.shape[1] if error.ndim == 3 else 0, len(self.drives))
        if not error.shape == load.shape == rate.shape == shape:
            raise ValueError(f'shapes {[tuple(x.shape) for x in given]} are not all {shape}')
        signals = torch.stack([error, load, rate])
        self._lost |= ~signals.isfinite().all(dim=3).all(dim=2).all(dim=0)
        signals[:, self._lost] = 0.0
        with torch.inference_mode():
            power = self._model.advance(*signals)
            power[self._lost] = torch.nan
        self._since += shape[1]
        return power.clone() if isinstance(position_error, Tensor) else power.numpy()


def _advance(model: PowerModel, drives: tuple[str, ...], robots: int) -> Advance:
    lacking = model.needs.lacking(('position_error', 'torque', 'velocity', 'power'))
    if lacking:
        raise InputError(
            f'{model.name}: {lacking}, and simulated robots give position error, torque and speed'
        )
    if isinstance(model, PowerPredictionNetwork):
        return NetworkBatch(model, drives, robots)
    if isinstance(model, EffectModel):
        return EffectBatch(model, drives, robots)
    if isinstance(model, Proxy):
        return ProxyBatch(model, drives)
    raise InputError(f'{model.name} cannot be run step by step; give ppn:RUN or a model.yaml')


class NetworkBatch:
    """Networks of one or more drive types with carried state."""

    def __init__(
        self, model: PowerPredictionNetwork, drives: tuple[str, ...], robots: int
    ) -> None:
        self.warm_up = model.checkpoint.config.warm_up
        columns = assign(drives, model.types)
        unknown = set(range(len(drives))) - {c for own in columns.values() for c in own}
        if unknown:
            raise InputError(f'{model.name} does not know the drive {drives[min(unknown)]}')
        self._robots, self._drives = robots, len(drives)
        self._parts = [
            DriveTypeLstm(columns[n.type.name], in_si_units(n))
            for n in model.checkpoint.networks
            if columns[n.type.name]
        ]
        with torch.inference_mode():
            self.reset(None)

    def reset(self, robots: Tensor | None) -> None:
        """Forget the past of the robots [n], or of all."""
        for part in self._parts:
            if robots is None:
                part.begin(self._robots)
            else:
                part.forget(
                    torch.zeros(self._robots, dtype=torch.bool).index_fill(0, robots, True)
                )

    def advance(self, error: Tensor, torque: Tensor, speed: Tensor) -> Tensor:
        """Return the mean power in W [N, D]."""
        result = torch.empty(self._robots, self._drives)
        features = torch.stack([error, torque, speed], dim=-1).transpose(0, 1)
        for part in self._parts:
            result[:, part.columns] = part(features)
        return result
