"""The suite's topics, their types, and the conversion of their messages to samples."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from power_recordings.messages import cdr
from power_recordings.messages.samples import (
    CmdVelSamples,
    DriveSamples,
    EstimateSamples,
    FootForceSamples,
    ImuSamples,
    JointSamples,
    MotorCurrentSamples,
    OdomSamples,
    Samples,
    SupplySamples,
)
from power_recordings.messages.topic_columns import Columns


@dataclass(frozen=True)
class Kind:
    """Conversion of a topic to samples: type, paths of the numbers, and constructor."""

    type_name: str
    paths: tuple[str, ...]
    build: Callable[[Columns], Samples]


def _paths(prefix: str, axes: str) -> tuple[str, ...]:
    return tuple(f'{prefix}.{axis}' for axis in axes)


def _joints(columns: Columns) -> JointSamples:
    names = columns.names()
    fields = (columns.by_name(path, names) for path in ('position', 'velocity', 'effort'))
    return JointSamples(columns.stamps(), names, *fields)


def _drives(columns: Columns) -> DriveSamples:
    names = columns.names()
    parts: dict[str, list[np.ndarray]] = {field: [] for field in ('stamp', 'order', *_DRIVES)}
    for block in columns.blocks:
        ticks = block.columns['device_time']
        samples = ticks.shape[1]
        since_first = (ticks - ticks[:, :1]).astype(np.int64)
        sequence = block.columns['sequence'][:, None] + np.arange(samples, dtype=np.uint64)
        celsius = columns.remapped(block, 'temperature', names)
        parts['stamp'].append((block.stamp_ns[:, None] + since_first).ravel())
        parts['order'].append(np.repeat(block.order, samples))
        parts['sequence'].append(sequence.ravel())
        parts['device_time'].append(ticks.ravel())
        parts['temperature'].append(np.repeat(celsius, samples, axis=0))
        for path in ('voltage', 'current', 'status'):
            parts[path].append(columns.remapped(block, path, names, samples))
    order = parts.pop('order')
    arrays = {field: columns.in_order(values, order) for field, values in parts.items()}
    return DriveSamples(arrays.pop('stamp'), names, **arrays)


def _supply(columns: Columns) -> SupplySamples:
    return SupplySamples(columns.stamps(), columns.scalars('voltage'), columns.scalars('current'))


def _motor_current(columns: Columns) -> MotorCurrentSamples:
    names = columns.names()
    return MotorCurrentSamples(columns.stamps(), names, columns.by_name('effort', names))


def _foot_force(columns: Columns) -> FootForceSamples:
    names = columns.names()
    return FootForceSamples(columns.stamps(), names, columns.by_name('effort', names))


def _imu(columns: Columns) -> ImuSamples:
    return ImuSamples(
        columns.stamps(),
        columns.vector('orientation', 'xyzw'),
        columns.vector('angular_velocity', 'xyz'),
        columns.vector('linear_acceleration', 'xyz'),
    )


def _odom(columns: Columns) -> OdomSamples:
    return OdomSamples(
        columns.stamps(),
        columns.vector('pose.pose.position', 'xyz'),
        columns.vector('pose.pose.orientation', 'xyzw'),
        columns.vector('twist.twist.linear', 'xyz'),
        columns.vector('twist.twist.angular', 'xyz'),
    )


def _cmd_vel(columns: Columns) -> CmdVelSamples:
    return CmdVelSamples(
        columns.stamps(), np.stack([columns.scalars(path) for path in _TWIST], axis=1)
    )


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
_JOINTS = ('position', 'velocity', 'effort')
_TWIST = ('twist.linear.x', 'twist.linear.y', 'twist.angular.z')
_IMU = (
    *_paths('orientation', 'xyzw'),
    *_paths('angular_velocity', 'xyz'),
    *_paths('linear_acceleration', 'xyz'),
)
_ODOM = (
    *_paths('pose.pose.position', 'xyz'),
    *_paths('pose.pose.orientation', 'xyzw'),
    *_paths('twist.twist.linear', 'xyz'),
    *_paths('twist.twist.angular', 'xyz'),
)

KINDS: Mapping[str, Kind] = {
    'drive_supply': Kind(cdr.DRIVE_SUPPLY, _DRIVES, _drives),
    'joint_states': Kind(cdr.JOINT_STATE, _JOINTS, _joints),
    'joint_commands': Kind(cdr.JOINT_STATE, _JOINTS, _joints),
    'supply': Kind(cdr.BATTERY_STATE, ('voltage', 'current'), _supply),
    'power_estimate': Kind(cdr.POWER_ESTIMATE, ('power', 'total', 'status'), _estimates),
    'imu': Kind(cdr.IMU, _IMU, _imu),
    'odom': Kind(cdr.ODOMETRY, _ODOM, _odom),
    'cmd_vel': Kind(cdr.TWIST_STAMPED, _TWIST, _cmd_vel),
    'motor_current': Kind(cdr.JOINT_STATE, ('effort',), _motor_current),
    'foot_force': Kind(cdr.JOINT_STATE, ('effort',), _foot_force),
}
