"""Scores of a walk: power by parts (Figure 5), tracking, smoothness, impacts."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from power_estimator.model import PowerModel
from wattwalk_core.anymal import JOINT_TYPES
from wattwalk_core.physics import GRAVITY

from policy_training.evaluation.gait_cycle import fast_share, gait_of
from policy_training.evaluation.measured_walk import RAW_RATE, MeasuredWalk

_WALKING: Final = 0.05  # m/s, slower has no cost of transport


def score_walk(
    walk: MeasuredWalk, idle: float, models: Mapping[str, PowerModel]
) -> dict[str, Any]:
    """
    Return the entry of `evaluate`'s JSON for a walk; idle: power of all drives at rest, W.

    power_w: `supply` is the power of the bench supply, `electronics` the part that does not reach
    the drives' meters, `idle` the drives at rest, and each joint type that of its four drives
    beyond that. estimated_w: by the first model, for the drives with the electronics measured;
    estimates has all models by joint type. None where nothing was steady.
    """
    steady = walk.steady
    tracking = _tracking(walk)
    entry: dict[str, Any] = {
        'name': walk.policy,
        'task': walk.task.name,
        'command': dict(zip(('vx', 'vy', 'yaw'), walk.task.command, strict=True)),
        'falls': walk.falls,
        'steady_s': round(float(steady.sum() / walk.data.rate), 2),
        'power_w': None,
        'estimated_w': None,
        'tracking': tracking,
        'cost_of_transport': None,
    }
    if not steady.any():
        return entry
    drawn = {kind: _of_type(walk, walk.data.power[steady], kind) for kind in JOINT_TYPES}
    supply = float(walk.data.supply[steady].mean())
    electronics = supply - sum(drawn.values())
    entry['power_w'] = {
        'supply': supply,
        'electronics': electronics,
        'idle': idle,
        **{kind: watts - idle / len(JOINT_TYPES) for kind, watts in drawn.items()},
    }
    entry['estimates'] = {}
    for name, model in models.items():
        data, rows = (walk.data, steady) if model.needs.smooth else (walk.raw, walk.raw_steady)
        power = model.predict(data)[rows]
        by_type = {kind: _of_type(walk, power, kind) for kind in JOINT_TYPES}
        entry['estimates'][name] = {'drives': sum(by_type.values()), **by_type}
    if models:
        entry['estimated_w'] = next(iter(entry['estimates'].values()))['drives'] + electronics
    speed = float(np.hypot(*walk.velocity[steady, :2].mean(axis=0)))
    if speed > _WALKING and max(map(abs, walk.task.command[:2])) > _WALKING:
        entry['cost_of_transport'] = supply / (walk.mass * GRAVITY * speed)
    entry['gait'] = asdict(gait_of(walk))
    entry['smoothness'] = _smoothness(walk)
    return _clean(entry)


def _tracking(walk: MeasuredWalk) -> dict[str, float | None]:
    names = ('vx', 'vy', 'yaw')
    if not walk.steady.any():
        return dict.fromkeys(names)
    away = np.array(walk.task.command) - walk.velocity[walk.steady].mean(axis=0)
    return dict(zip(names, (float(value) for value in away), strict=True))


def _smoothness(walk: MeasuredWalk) -> dict[str, float]:
    raw, steady = walk.raw, walk.raw_steady
    kfe = [i for i, name in enumerate(raw.names) if name.endswith('KFE')]
    torque = raw.torque[steady].astype(np.float64)
    velocity = raw.velocity[steady].astype(np.float64)
    jumps = np.abs(np.diff(raw.command.astype(np.float64), axis=0)).sum(axis=0) * RAW_RATE
    return {
        'torque_rms_nm': float(np.sqrt(np.mean(np.square(torque)))),
        'kfe_torque_rms_nm': float(np.sqrt(np.mean(np.square(torque[:, kfe])))),
        'kfe_velocity_rms': float(np.sqrt(np.mean(np.square(velocity[:, kfe])))),
        'kfe_torque_above_20_hz': fast_share(walk),
        'target_change_per_s': float(jumps.mean() / len(raw.command)),
    }


def _of_type(walk: MeasuredWalk, power: NDArray[np.floating], kind: str) -> float:
    columns = [i for i, name in enumerate(walk.data.names) if name.endswith(kind)]
    return float(np.nanmean(power[:, columns], axis=0).sum())


def _clean(value: Any) -> Any:
    """Return content with None for NaN, which JSON lacks."""
    if isinstance(value, dict):
        return {key: _clean(item) for key, item in value.items()}
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value
