"""Topics of the live system from a session's readings: bus quantisation and ROS stamps."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from power_daq.bus.description import BusDescription
from power_recordings.messages import samples
from power_recordings.reading.reader import Recording
from wattwalk_core.anymal import FOOT_NAMES
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError

from sim_bridge.offline.session import Event, SessionPart
from sim_bridge.sensors.blocks import BusColumns
from sim_bridge.sensors.sensors import DeviceClock

START_NS: Final = 1_750_000_000_000_000_000  # ROS time of step 0 in offline runs


@dataclass(frozen=True)
class Rows:
    """N samples of a topic with their stamps; values by the name of the quantity, [N, ...]."""

    stamp_ns: NDArray[np.int64]
    values: dict[str, NDArray[Any]]


@dataclass(frozen=True)
class Telemetry:
    """Half a second of a run: rows of each topic that the world has, and events."""

    topics: Mapping[str, Rows]
    events: tuple[Event, ...] = ()


class Wire:
    """Bus quantisation and stamping of a world's samples."""

    def __init__(
        self,
        bus: BusDescription,
        joints: Sequence[str],
        measured: Sequence[str],
        clock: DeviceClock,
        initial_temperature: Floats,
    ) -> None:
        """Make a wire; joints: of the world; measured: those metered; initial_temperature: °C [D].

        InputError for a drive that is not among the joints, or not on the bus.
        """
        for drive in measured:
            if drive not in joints:
                raise InputError(f'no drive {drive!r}; there are {", ".join(joints)}')
        self._bus, self._columns = bus, BusColumns(bus, joints)
        self._measured = [joints.index(drive) for drive in measured]
        self._clock = clock
        self._temperature = initial_temperature

    def send(self, stretch: SessionPart) -> Telemetry:
        """Return readings as received: quantised by the bus, with ROS stamps, by topic."""
        read = stretch.samples
        meter, joints, supply = read.electrical, read.joints, read.supply
        voltage, current = self._quantised('electrical', meter.voltage, meter.current)
        position, velocity, effort = self._quantised(
            'joints', joints.position, joints.velocity, joints.torque
        )
        kept = self._measured
        topics = {
            'drive_supply': self._rows(
                meter.step,
                device_time=self._clock.device_ns(meter.step).astype(np.uint64),
                voltage=voltage[:, kept],
                current=current[:, kept],
                temperature=self._latest_temperature(stretch)[:, kept],
                status=meter.status[:, kept],
            ),
            'joint_states': self._rows(
                joints.step, position=position, velocity=velocity, effort=effort
            ),
            'joint_commands': self._rows(stretch.step, **stretch.commands),
            'supply': self._rows(supply.step, voltage=supply.voltage, current=supply.current),
        }
        if (body := read.body) is not None:
            topics['imu'] = self._rows(
                body.step,
                orientation=body.orientation,
                angular_velocity=body.rate,
                linear_acceleration=body.acceleration,
            )
            topics['foot_force'] = self._rows(body.step, effort=body.foot_force)
        if (odometry := read.odometry) is not None:
            topics['odom'] = self._rows(
                odometry.step,
                position=odometry.position,
                orientation=odometry.orientation,
                linear_velocity=odometry.velocity,
                angular_velocity=odometry.rate,
            )
        if stretch.base_velocity is not None:
            topics['cmd_vel'] = self._rows(stretch.step, velocity=stretch.base_velocity)
        return Telemetry(topics, stretch.events)

    def _rows(self, step: NDArray[np.int64], **values: NDArray[Any]) -> Rows:
        return Rows(START_NS + self._clock.elapsed_ns(step), values)

    def _quantised(self, group: str, *quantities: Floats) -> list[Floats]:
        """Return quantities of the joints, [N, D] each, as the bus transmits them."""
        wide = self._bus.quantise(group, *map(self._columns.spread, quantities))
        return [values[:, self._columns.places] for values in wide]

    def _latest_temperature(self, stretch: SessionPart) -> Floats:
        reading = stretch.samples.temperature
        (received,) = self._quantised('temperature', reading.temperature)
        known = np.vstack((self._temperature, received))
        self._temperature = known[-1]
        steps = stretch.samples.electrical.step
        return known[np.searchsorted(reading.step, steps, side='right')]


_JOINT_FIELDS: Final = ('position', 'velocity', 'effort')
_PLAIN: Final[dict[str, Any]] = {
    'supply': samples.SupplySamples,
    'imu': samples.ImuSamples,
    'odom': samples.OdomSamples,
    'cmd_vel': samples.CmdVelSamples,
}


def gather(
    name: str, stretches: Sequence[Telemetry], joints: Sequence[str], measured: Sequence[str]
) -> Recording:
    """Join a run's telemetry to a recording in memory; joints, measured: names of columns."""
    found: dict[str, list[Rows]] = {}
    for stretch in stretches:
        for topic, rows in stretch.topics.items():
            found.setdefault(topic, []).append(rows)
    held = {
        topic: _samples(topic, _join(parts), tuple(joints), tuple(measured))
        for topic, parts in found.items()
    }
    return Recording.in_memory(name, held)


def _samples(
    topic: str, rows: Rows, joints: tuple[str, ...], measured: tuple[str, ...]
) -> samples.Samples:
    stamps, values = rows.stamp_ns, rows.values
    if topic == 'drive_supply':
        sequence = np.arange(len(stamps), dtype=np.uint64)
        return samples.DriveSamples(stamps, measured, sequence, **values)
    if topic == 'foot_force':
        return samples.FootForceSamples(stamps, FOOT_NAMES, values['effort'])
    if topic in ('joint_states', 'joint_commands'):
        absent = np.full((len(stamps), len(joints)), np.nan, np.float32)
        fields = (values.get(key, absent) for key in _JOINT_FIELDS)
        return samples.JointSamples(stamps, joints, *fields)
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
