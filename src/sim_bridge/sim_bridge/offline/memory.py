"""A simulated run as a recording in memory."""

from collections.abc import Sequence
from typing import Any, Final

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

_JOINT_FIELDS: Final = ('position', 'velocity', 'effort')
_PLAIN: Final[dict[str, Any]] = {
    'supply': SupplySamples,
    'imu': ImuSamples,
    'odom': OdomSamples,
    'cmd_vel': CmdVelSamples,
}


def gather(
    name: str, stretches: Sequence[Telemetry], joints: Sequence[str], measured: Sequence[str]
) -> Recording:
    """Return a run as a recording; joints and measured name the columns of states and powers."""
    topics = dict.fromkeys(topic for stretch in stretches for topic in stretch.topics)
    found = {}
    for topic in topics:
        rows = _join([part.topics[topic] for part in stretches if topic in part.topics])
        found[topic] = _samples(topic, rows, tuple(joints), tuple(measured))
    return Recording.in_memory(name, found)


def _samples(
    topic: str, rows: Rows, joints: tuple[str, ...], measured: tuple[str, ...]
) -> Samples:
    stamps, values = rows.stamp_ns, rows.values
    if topic == 'drive_supply':
        sequence = np.arange(len(stamps), dtype=np.uint64)
        return DriveSamples(stamps, measured, sequence, **values)
    if topic == 'foot_force':
        return FootForceSamples(stamps, FOOT_NAMES, values['effort'])
    if topic in ('joint_states', 'joint_commands'):
        absent = np.full((len(stamps), len(joints)), np.nan, np.float32)
        return JointSamples(stamps, joints, *(values.get(key, absent) for key in _JOINT_FIELDS))
    return _PLAIN[topic](stamps, **values)  # type: ignore[no-any-return]


def _join(parts: Sequence[Rows]) -> Rows:
    """Return parts as one, NaN where one lacks a quantity; floats as in messages."""
    shapes = {name: values.shape[1:] for rows in parts for name, values in rows.values.items()}
    values = {
        name: np.concatenate([_column(rows, name, shape) for rows in parts])
        for name, shape in shapes.items()
    }
    return Rows(np.concatenate([rows.stamp_ns for rows in parts]), values)


def _column(rows: Rows, name: str, shape: tuple[int, ...]) -> NDArray[Any]:
    values = rows.values.get(name)
    if values is None:
        return np.full((len(rows.stamp_ns), *shape), np.nan, np.float32)
    return values.astype(np.float32) if values.dtype == np.float64 else values
