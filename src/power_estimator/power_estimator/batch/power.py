"""Power of many simulated robots side by side, for rewards in training."""

import math
from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from power_recordings.alignment.dataset import AlignedDataset
from torch import Tensor
from wattwalk_core.arrays import Bools, Floats, Singles
from wattwalk_core.errors import InputError

from power_estimator.drive_types import assign, owners
from power_estimator.effects import Signals
from power_estimator.effects.fit.design import evaluate
from power_estimator.effects.model_file.model import EffectModel
from power_estimator.effects.signals.prepared import rate_of
from power_estimator.effects.signals.scale import DriveScale
from power_estimator.loader import load_model
from power_estimator.model import PowerModel
from power_estimator.network.ppn import PowerPredictionNetwork
from power_estimator.portable.export import in_si_units
from power_estimator.portable.power_term import DriveTypeLstm
from power_estimator.proxies import PROXIES, WATTS, Proxy

RATE = 200.0  # Hz of the samples
LONGEST = 0.1  # s of the past beside the new samples, for derivatives and the spring


class EffectBatch:
    """Model of named effects, evaluated at each step on the last samples of each robot.

    The newest derivative is one-sided. Each robot has a separate bus at nominal voltage.
    InputError for a model that is not fitted, stands on a base, lacks a drive, or remembers more
    than 0.1 s, such as the winding's temperature.
    """

    warm_up = 1

    def __init__(self, model: EffectModel, drives: tuple[str, ...], robots: int) -> None:
        if not model.fitted or model.base is not None:
            what = 'stands on another model' if model.base else 'has no coefficients yet'
            raise InputError(f'{model.name} {what}; give a fitted model that stands alone')
        found = owners(drives, model.groups)
        if None in found:
            raise InputError(f'{model.name} does not know the drive {drives[found.index(None)]}')
        members = [group for group in found if group is not None]
        self._structure, self._coefficients = model.structure, model.coefficients(members)
        self._lag = np.array([g.velocity_lag for g in members])
        self._voltage = np.array([g.voltage for g in members])
        self._scale = DriveScale.stack([g.scale for g in members])
        self._names = drives
        needs = model.needs_in(drives)
        if needs.memory > LONGEST:
            raise InputError(
                f'{model.name}: {needs.remembers} remembers more than the last '
                f'{1e3 * LONGEST:.0f} ms, which are all that is kept step by step'
            )
        self._kept = math.ceil(needs.memory * RATE)
        self._past = np.zeros((self._kept, 2, robots, len(drives)))
        self._fresh = np.ones(robots, bool)

    def reset(self, robots: Tensor) -> None:
        """Forget the past of the robots marked in [N]."""
        self._fresh |= robots.numpy()

    def advance(self, error: Tensor, torque: Tensor, speed: Tensor) -> Tensor:
        """Return the mean power in W [N, D] over S samples [N, S, D]; the error is not used."""
        new = torch.stack([torque, speed]).permute(2, 0, 1, 3).numpy().astype(float)
        self._past[:, :, self._fresh] = new[:1, :, self._fresh]
        self._fresh[:] = False
        rows = np.concatenate([self._past, new])
        self._past = rows[-self._kept :]
        power = evaluate(self._structure, self._coefficients, self._signals(rows))
        by_robot = power.reshape(rows.shape[2], len(rows), rows.shape[3])[:, self._kept :]
        return torch.from_numpy(by_robot.mean(axis=1).astype(np.float32))

    def _signals(self, rows: Floats) -> Signals:
        """Return signals, the robots as recordings of the same drives; rows is [S, 2, N, D]."""
        count, _, robots, drives = rows.shape
        whole = [slice(0, count)]
        torque, speed = rows[:, 0], rows[:, 1]
        speed = speed + self._lag * rate_of(speed, whole, RATE)
        acceleration, torque_rate = (rate_of(x, whole, RATE) for x in (speed, torque))
        torque, speed, acceleration, torque_rate = (
            x.transpose(1, 0, 2).reshape(-1, drives)
            for x in (torque, speed, acceleration, torque_rate)
        )
        unknown = np.full_like(torque, np.nan)
        number = np.repeat(np.arange(robots, dtype=np.int32), count)
        return Signals(
            rate=RATE,
            names=self._names,
            time=np.tile(np.arange(count) / RATE, robots),
            segment=number,
            recording=number,
            position=unknown,
            velocity=speed,
            acceleration=acceleration,
            torque=torque,
            torque_rate=torque_rate,
            voltage=np.broadcast_to(self._voltage, torque.shape),
            temperature=unknown,
            motor_velocity=speed,
            motor_acceleration=acceleration,
            motor_torque=torque,
            torque_cost=np.zeros_like(torque),
            electronics=np.zeros_like(torque),
            drawn=torque * speed,
            scale=self._scale,
            at_motor=np.zeros(drives, dtype=bool),
        )


class ProxyBatch:
    """Proxy that was scaled to measured power, or that is in watts by itself; else InputError."""

    warm_up = 0

    def __init__(self, model: Proxy, drives: Sequence[str]) -> None:
        unscaled = 1.0 if model.name in WATTS and not model.factors else np.nan
        self._factors = np.full(len(drives), unscaled, np.float32)
        for name, own in assign(drives, model.types).items():
            self._factors[own] = model.factors.get(name, np.nan)
        unknown = [d for d, f in zip(drives, self._factors, strict=True) if not np.isfinite(f)]
        if unknown:
            raise InputError(
                f'{model.name} has no unit of power for {unknown[0]}: scale it to measured power'
            )
        self._signal = PROXIES[model.name]

    def reset(self, robots: Tensor) -> None:
        """Do nothing: no past is kept."""

    def advance(self, error: Tensor, torque: Tensor, speed: Tensor) -> Tensor:
        """Return the mean power in W [N, D] over S samples [N, S, D]; S ≥ 2 for acceleration."""
        robots, count, drives = torque.shape
        load, rate = (x.permute(1, 0, 2).reshape(count, -1).numpy() for x in (torque, speed))
        names, time = ('',) * load.shape[1], np.arange(count) / RATE
        data = AlignedDataset.blank(RATE, names, time, 'batch', torque=load, velocity=rate)
        signal = self._signal(data).reshape(count, robots, drives)
        return torch.from_numpy((signal.mean(axis=0) * self._factors).astype(np.float32))


Array = Singles | Tensor


class BatchPower:
    """A stateful power model over N robots with D drives each.

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
        """Load `ppn:RUN` or a model file; InputError as for `load_model` and the constructor."""
        return cls(load_model(spec), drives, robots)

    @property
    def ready(self) -> Bools:
        """Mark the robots [N] whose estimate is past its warm-up."""
        return self._since > self._model.warm_up

    def reset(self, ids: Sequence[int] | NDArray[np.integer] | Tensor | None = None) -> None:
        """Forget the past of the robots with these numbers [n], or of all."""
        robots = torch.full((self.robots,), ids is None)
        if ids is not None:
            robots[torch.as_tensor(ids, dtype=torch.long)] = True
        with torch.inference_mode():
            self._model.reset(robots)
        self._since[robots.numpy()] = 0
        self._lost &= ~robots

    def step(self, position_error: Array, torque: Array, speed: Array) -> Array:
        """Return the mean power in W [N, D] of the next samples, [N, S, D] in rad, N·m and rad/s.

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


def _advance(
    model: PowerModel, drives: tuple[str, ...], robots: int
) -> 'NetworkBatch | EffectBatch | ProxyBatch':
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
    """Networks of one or more drive types with carried state; InputError for an unknown drive."""

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
            for part in self._parts:
                part.begin(robots)

    def reset(self, robots: Tensor) -> None:
        """Forget the past of the robots marked in [N]."""
        for part in self._parts:
            part.forget(robots)

    def advance(self, error: Tensor, torque: Tensor, speed: Tensor) -> Tensor:
        """Return the mean power in W [N, D] over S samples [N, S, D] in rad, N·m and rad/s."""
        result = torch.empty(self._robots, self._drives)
        features = torch.stack([error, torque, speed], dim=-1).transpose(0, 1)
        for part in self._parts:
            result[:, part.columns] = part(features)
        return result
