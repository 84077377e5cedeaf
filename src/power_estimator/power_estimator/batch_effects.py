"""Models of effects and proxies over many robots, from the samples that were simulated last."""

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from power_daq.cli import InputError
from power_daq.recording.aligned import AlignedDataset
from torch import Tensor

from power_estimator.drive_types import assign
from power_estimator.effect_design import evaluate
from power_estimator.effect_model import EffectModel
from power_estimator.effect_signals import rate_of
from power_estimator.effects import Signals
from power_estimator.proxies import PROXIES, Proxy

Doubles = NDArray[np.float64]
RATE = 200.0  # Hz of the samples
KEPT = 4  # samples of the past beside the new ones, for derivatives


class EffectBatch:
    """
    A model of named effects, evaluated anew on the last samples of each robot.

    Its effects are instantaneous or look back over a few samples; the newest derivative is
    one-sided. Position, bus voltage and temperature are not known while training: the voltage is
    the nominal one, and a model with an effect that needs one of the others is refused.
    """

    warm_up = 1

    def __init__(self, model: EffectModel, drives: tuple[str, ...], robots: int) -> None:
        if not model.fitted or model.base is not None:
            what = 'stands on another model' if model.base else 'has no coefficients yet'
            raise InputError(f'{model.name} {what}; give a fitted model that stands alone')
        columns = assign(drives, [group.type for group in model.groups])
        owner = {c: g for g in model.groups for c in columns[g.type.name]}
        unknown = [name for c, name in enumerate(drives) if c not in owner]
        if unknown:
            raise InputError(f'{model.name} does not know the drive {unknown[0]}')
        members = [owner[c] for c in range(len(drives))]
        rows = [
            [
                value.value
                for active in model.structure.free
                for value in g.coefficients[active.name]
            ]
            for g in members
        ]
        self._structure = model.structure
        self._coefficients = np.tile(np.array(rows).reshape(len(drives), -1), (robots, 1))
        self._lag = np.tile([g.velocity_lag for g in members], robots)
        self._voltage = np.tile([g.voltage for g in members], robots)
        self._names = tuple(drives) * robots
        self._shape = (robots, len(drives))
        self._past = np.zeros((KEPT, 2, *self._shape))
        self._fresh = np.ones(robots, bool)
        still = torch.zeros(robots, 1, len(drives))
        try:
            self.advance(still, still, still)
        except InputError as error:
            raise InputError(
                f'{model.name} needs more than position error, torque and speed: {error}'
            ) from None
        self.reset(None)

    def reset(self, robots: Tensor | None) -> None:
        """Forget the past of the robots [n], or of all."""
        self._fresh[slice(None) if robots is None else robots.numpy()] = True

    def advance(self, error: Tensor, torque: Tensor, speed: Tensor) -> Tensor:
        """Mean power in W [N, D] over S samples [N, S, D]."""
        new = torch.stack([torque, speed]).permute(2, 0, 1, 3).numpy().astype(float)
        self._past[:, :, self._fresh] = new[:1, :, self._fresh]
        self._fresh[:] = False
        rows = np.concatenate([self._past, new])
        self._past = rows[-KEPT:]
        power = evaluate(self._structure, self._coefficients, self._signals(rows))[KEPT:]
        return torch.from_numpy(power.mean(axis=0).reshape(self._shape).astype(np.float32))

    def _signals(self, rows: Doubles) -> Signals:
        count = len(rows)
        torque, speed = (rows[:, i].reshape(count, -1) for i in range(2))
        whole = [slice(0, count)]
        speed = speed + self._lag * rate_of(speed, whole, RATE)
        acceleration = rate_of(speed, whole, RATE)
        unknown = np.full_like(torque, np.nan)
        return Signals(
            rate=RATE,
            names=self._names,
            time=np.arange(count) / RATE,
            segment=np.zeros(count, np.int32),
            recording=np.zeros(count, np.int32),
            position=unknown,
            velocity=speed,
            acceleration=acceleration,
            torque=torque,
            torque_rate=rate_of(torque, whole, RATE),
            voltage=np.broadcast_to(self._voltage, torque.shape),
            temperature=unknown,
            motor_velocity=speed,
            motor_acceleration=acceleration,
            motor_torque=torque,
            torque_cost=np.zeros_like(torque),
            electronics=np.zeros_like(torque),
            drawn=torque * speed,
        )


class ProxyBatch:
    """A proxy that was scaled to measured power."""

    warm_up = 0

    def __init__(self, model: Proxy, drives: Sequence[str]) -> None:
        columns = assign(drives, model.types)
        self._factors = np.full(len(drives), np.nan, np.float32)
        for name, own in columns.items():
            self._factors[own] = model.factors.get(name, np.nan)
        unknown = [d for d, f in zip(drives, self._factors, strict=True) if not np.isfinite(f)]
        if unknown:
            raise InputError(
                f'{model.name} has no unit of power for {unknown[0]}: scale it to measured power'
            )
        self._signal = PROXIES[model.name]

    def reset(self, robots: Tensor | None) -> None:
        """Nothing is kept of the past."""

    def advance(self, error: Tensor, torque: Tensor, speed: Tensor) -> Tensor:
        """Mean power in W [N, D] over S samples [N, S, D]; S ≥ 2 where it differentiates."""
        robots, count, drives = torque.shape
        flat = [x.permute(1, 0, 2).reshape(count, -1).numpy() for x in (torque, speed)]
        signal = self._signal(_dataset(*flat)).reshape(count, robots, drives)
        return torch.from_numpy((signal.mean(axis=0) * self._factors).astype(np.float32))


def _dataset(torque: NDArray[np.float32], speed: NDArray[np.float32]) -> AlignedDataset:
    unknown = np.full_like(torque, np.nan)
    none = np.zeros(len(torque), np.int32)
    return AlignedDataset(
        rate=RATE,
        names=('',) * torque.shape[1],
        time=np.arange(len(torque)) / RATE,
        segment=none,
        position=unknown,
        velocity=speed,
        torque=torque,
        command=unknown,
        power=unknown,
        voltage=unknown,
        current=unknown,
        temperature=unknown,
        supply=unknown[:, 0],
        recordings=('batch',),
        recording=none,
    )
