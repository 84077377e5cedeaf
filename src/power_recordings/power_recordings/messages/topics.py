"""The suite's topics, their types, and the conversion of their messages to samples."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from wattwalk_core.arrays import Singles, Stamps
from wattwalk_core.errors import InputError

from power_recordings.messages import cdr, samples
from power_recordings.messages.samples import DriveSamples, EstimateSamples, Samples
from power_recordings.messages.topic_columns import Columns


@dataclass(frozen=True)
class Kind:
    """Conversion of a topic to samples: message type, field paths to read, and constructor."""

    type_name: str
    paths: tuple[str, ...]
    build: Callable[[Columns], Samples]


def _vectors(type_name: str, kind: Callable[..., Samples]) -> Kind:
    """Return the kind of messages of vectors, which `cdr.VECTORS` lists."""

    def build(columns: Columns) -> Samples:
        vectors = (columns.vector(path, axes) for path, axes in cdr.VECTORS[type_name])
        return kind(columns.stamps(), *vectors)

    return Kind(type_name, cdr.vector_paths(type_name), build)


def _by_name(kind: Callable[..., Samples], *fields: str) -> Kind:
    """Return the kind of JointState messages of which these fields count."""

    def build(columns: Columns) -> Samples:
        names = columns.names()
        return kind(columns.stamps(), names, *(columns.by_name(path, names) for path in fields))

    return Kind(cdr.JOINT_STATE, fields, build)


def _drives(columns: Columns) -> DriveSamples:
    names = columns.names()
    parts: dict[str, list[np.ndarray]] = {field: [] for field in ('stamp', 'order', *_DRIVES)}
    for block in columns.blocks:
        ticks = block.columns['device_time']
        count = ticks.shape[1]
        since_first = (ticks - ticks[:, :1]).astype(np.int64)
        sequence = block.columns['sequence'][:, None] + np.arange(count, dtype=np.uint64)
        celsius = columns.remapped(block, 'temperature', names)
        parts['stamp'].append((block.stamp_ns[:, None] + since_first).ravel())
        parts['order'].append(np.repeat(block.order, count))
        parts['sequence'].append(sequence.ravel())
        parts['device_time'].append(ticks.ravel())
        parts['temperature'].append(np.repeat(celsius, count, axis=0))
        for path in ('voltage', 'current', 'status'):
            parts[path].append(columns.remapped(block, path, names, count))
    order = parts.pop('order')
    arrays = {field: columns.in_order(values, order) for field, values in parts.items()}
    return DriveSamples(arrays.pop('stamp'), names, **arrays)


def _supply(columns: Columns) -> Samples:
    voltage, current = columns.scalars('voltage'), columns.scalars('current')
    return samples.SupplySamples(columns.stamps(), voltage, current)


def _cmd_vel(stamp_ns: Stamps, linear: Singles, angular: Singles) -> Samples:
    return samples.CmdVelSamples(stamp_ns, np.hstack([linear, angular]))


def _estimates(columns: Columns) -> EstimateSamples:
    names = columns.names()
    return EstimateSamples(
        columns.stamps(),
        names,
        columns.names('model'),
        columns.by_name('power', names),
        columns.scalars('total'),
        columns.scalars('status'),
    )


_DRIVES = ('sequence', 'device_time', 'voltage', 'current', 'temperature', 'status')
_JOINTS = _by_name(samples.JointSamples, 'position', 'velocity', 'effort')

KINDS: Mapping[str, Kind] = {
    'drive_supply': Kind(cdr.DRIVE_SUPPLY, _DRIVES, _drives),
    'joint_states': _JOINTS,
    'joint_commands': _JOINTS,
    'supply': Kind(cdr.BATTERY_STATE, ('voltage', 'current'), _supply),
    'power_estimate': Kind(cdr.POWER_ESTIMATE, ('power', 'total', 'status'), _estimates),
    'imu': _vectors(cdr.IMU, samples.ImuSamples),
    'odom': _vectors(cdr.ODOMETRY, samples.OdomSamples),
    'cmd_vel': _vectors(cdr.TWIST_STAMPED, _cmd_vel),
    'motor_current': _by_name(samples.MotorCurrentSamples, 'effort'),
    'motor_temperature': _by_name(samples.MotorTemperatureSamples, 'effort'),
    'foot_force': _by_name(samples.FootForceSamples, 'effort'),
}


TYPES: Mapping[str, str] = {
    **{name: kind.type_name for name, kind in KINDS.items() if not name.startswith('motor_')},
    'diagnostics': cdr.DIAGNOSTIC_ARRAY,
}
"""Types of the topics that nodes of the suite publish; `motor_…` are from logs alone."""


def message_class(type_name: str) -> Any:
    """Return the ROS message class of `package/msg/Type`; InputError if not importable."""
    package, _, name = type_name.split('/')
    try:
        return getattr(import_module(f'{package}.msg'), name)
    except (ImportError, AttributeError) as error:
        raise InputError(f'cannot record {type_name}: {error}; is {package} sourced?') from error
