"""Topics of the live system from a session's readings: bus quantisation and ROS stamps."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from power_daq.bus.description import BusDescription
from wattwalk_core.errors import InputError

from sim_bridge.offline.session import Event, SessionPart
from sim_bridge.sensors.meter import DeviceClock

Floats = NDArray[np.float64]
Stamps = NDArray[np.int64]
START_NS: Final = 1_750_000_000_000_000_000
"""ROS time of step 0 in offline runs."""


@dataclass(frozen=True)
class Rows:
    """N samples by the name of the quantity, [N, ...] each, with their stamps."""

    stamp_ns: Stamps
    values: dict[str, Floats]


@dataclass(frozen=True)
class Telemetry:
    """One stretch, topic by topic; None for what the world does not have."""

    electrical: Rows  # voltage, current, status, temperature [N, D measured], device_ns [N]
    joints: Rows  # position, velocity, effort [N, D]
    commands: Rows  # position, velocity or effort, those that were given [N, D]
    supply: Rows  # voltage, current [N], negative while drawing
    cmd_vel: Rows | None  # velocity [N, 3]
    imu: Rows | None  # orientation x y z w, rate, acceleration
    odom: Rows | None  # position, orientation x y z w, velocity, rate
    foot_force: Rows | None  # effort [N, 4]
    events: tuple[Event, ...]


class Wire:
    """Puts samples of a world's joints through the bus's quantisation and the stamping."""

    def __init__(
        self,
        bus: BusDescription,
        joints: Sequence[str],
        measured: Sequence[str],
        clock: DeviceClock,
        initial_temperature: Floats,
    ) -> None:
        """
        joints: the world's D. measured: those of them whose power is metered.

        InputError for a drive that is not among the joints, or not on the bus.
        """
        for drive in measured:
            if drive not in joints:
                raise InputError(f'no drive {drive!r}; there are {", ".join(joints)}')
        for joint in joints:
            if joint not in bus.drives:
                raise InputError(f'joint {joint!r} is not on the bus; {", ".join(bus.drives)} are')
        self._bus = bus
        self._places = [bus.drives.index(joint) for joint in joints]
        self._measured = [joints.index(drive) for drive in measured]
        self._clock = clock
        self._temperature = initial_temperature

    def send(self, stretch: SessionPart) -> Telemetry:
        """What arrives of a stretch."""
        samples, commands = stretch.samples, stretch.commands
        meter, joints, supply = samples.electrical, samples.joints, samples.supply
        voltage, current = self._bus.quantise_electrical(
            self._spread(meter.voltage), self._spread(meter.current)
        )
        kept = [self._places[index] for index in self._measured]
        quantised = self._bus.quantise_joints(
            *(self._spread(x) for x in (joints.position, joints.velocity, joints.torque))
        )
        names = ('position', 'velocity', 'effort')
        given = {name: getattr(commands, name) for name in names}
        body, odometry = samples.body, samples.odometry
        return Telemetry(
            electrical=self._rows(
                meter.step,
                voltage=voltage[:, kept],
                current=current[:, kept],
                status=meter.status[:, self._measured],
                temperature=self._latest_temperature(stretch)[:, self._measured],
                device_ns=self._clock.device_ns(meter.step),
            ),
            joints=self._rows(
                joints.step,
                **{n: v[:, self._places] for n, v in zip(names, quantised, strict=True)},
            ),
            commands=self._rows(
                commands.step, **{name: v for name, v in given.items() if v is not None}
            ),
            supply=self._rows(supply.step, voltage=supply.voltage, current=supply.current),
            cmd_vel=None
            if commands.base_velocity is None
            else self._rows(commands.step, velocity=commands.base_velocity),
            imu=body
            and self._rows(
                body.step,
                orientation=body.orientation,
                rate=body.rate,
                acceleration=body.acceleration,
            ),
            odom=odometry
            and self._rows(
                odometry.step,
                position=odometry.position,
                orientation=odometry.orientation,
                velocity=odometry.velocity,
                rate=odometry.rate,
            ),
            foot_force=body and self._rows(body.step, effort=body.foot_force),
            events=stretch.events,
        )

    def _rows(self, step: NDArray[np.int64], **values: Floats) -> Rows:
        return Rows(START_NS + self._clock.elapsed_ns(step), values)

    def _spread(self, values: Floats) -> Floats:
        wide = np.zeros((len(values), len(self._bus.drives)))
        wide[:, self._places] = values
        return wide

    def _latest_temperature(self, stretch: SessionPart) -> Floats:
        reading = stretch.samples.temperature
        wide = self._bus.quantise_temperature(self._spread(reading.temperature))
        known = np.vstack((self._temperature, wide[:, self._places]))
        self._temperature = known[-1]
        steps = stretch.samples.electrical.step
        latest: Floats = known[np.searchsorted(reading.step, steps, side='right')]
        return latest
