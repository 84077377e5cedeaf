"""A simulated run as a recording that was never on disk."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from power_recordings.messages.samples import (
    CmdVelSamples,
    DriveSamples,
    FootForceSamples,
    ImuSamples,
    JointSamples,
    OdomSamples,
    Samples,
    SupplySamples,
)
from power_recordings.reading.reader import Recording
from wattwalk_core.anymal import FOOT_NAMES

from sim_bridge.offline.telemetry import Rows, Telemetry


def gather(
    name: str, stretches: Sequence[Telemetry], joints: Sequence[str], measured: Sequence[str]
) -> Recording:
    """The stretches of one run; joints and measured name the columns of states and powers."""
    samples: dict[str, Samples] = {}
    if rows := _join(stretches, lambda t: t.electrical):
        samples['drive_supply'] = _drive_samples(rows, measured)
    if rows := _join(stretches, lambda t: t.joints):
        samples['joint_states'] = _joint_samples(rows, joints)
    if rows := _join(stretches, lambda t: t.commands):
        samples['joint_commands'] = _joint_samples(rows, joints)
    if rows := _join(stretches, lambda t: t.supply):
        samples['supply'] = SupplySamples(rows.stamp_ns, *_columns(rows, 'voltage', 'current'))
    if rows := _join(stretches, lambda t: t.foot_force):
        samples['foot_force'] = FootForceSamples(
            rows.stamp_ns, FOOT_NAMES, *_columns(rows, 'effort')
        )
    if rows := _join(stretches, lambda t: t.cmd_vel):
        samples['cmd_vel'] = CmdVelSamples(rows.stamp_ns, *_columns(rows, 'velocity'))
    if rows := _join(stretches, lambda t: t.imu):
        columns = _columns(rows, 'orientation', 'rate', 'acceleration')
        samples['imu'] = ImuSamples(rows.stamp_ns, *columns)
    if rows := _join(stretches, lambda t: t.odom):
        columns = _columns(rows, 'position', 'orientation', 'velocity', 'rate')
        samples['odom'] = OdomSamples(rows.stamp_ns, *columns)
    return Recording.in_memory(name, samples)


def _join(stretches: Sequence[Telemetry], pick: Callable[[Telemetry], Rows | None]) -> Rows | None:
    found = [rows for rows in map(pick, stretches) if rows is not None]
    if not found:
        return None
    shapes = {name: values.shape[1:] for rows in found for name, values in rows.values.items()}
    return Rows(
        np.concatenate([rows.stamp_ns for rows in found]),
        {
            name: np.concatenate([_column(rows, name, shape) for rows in found])
            for name, shape in shapes.items()
        },
    )


def _column(rows: Rows, name: str, shape: tuple[int, ...]) -> NDArray[Any]:
    values = rows.values.get(name)
    return np.full((len(rows.stamp_ns), *shape), np.nan) if values is None else values


def _drive_samples(rows: Rows, measured: Sequence[str]) -> DriveSamples:
    voltage, current, temperature = _columns(rows, 'voltage', 'current', 'temperature')
    return DriveSamples(
        stamp_ns=rows.stamp_ns,
        names=tuple(measured),
        sequence=np.arange(len(rows.stamp_ns), dtype=np.uint64),
        device_time=rows.values['device_ns'].astype(np.uint64),
        voltage=voltage,
        current=current,
        temperature=temperature,
        status=rows.values['status'].astype(np.uint8),
    )


def _joint_samples(rows: Rows, joints: Sequence[str]) -> JointSamples:
    absent = np.full((len(rows.stamp_ns), len(joints)), np.nan, dtype=np.float32)
    found = (rows.values.get(name) for name in ('position', 'velocity', 'effort'))
    return JointSamples(
        rows.stamp_ns, tuple(joints), *(absent if v is None else _float32(v) for v in found)
    )


def _columns(rows: Rows, *names: str) -> list[NDArray[np.float32]]:
    return [_float32(rows.values[name]) for name in names]


def _float32(values: Any) -> NDArray[np.float32]:
    return np.asarray(values, dtype=np.float32)
