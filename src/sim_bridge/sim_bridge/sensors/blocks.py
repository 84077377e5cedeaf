"""Instruments of the plant, read block by block."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray
from power_daq.bus.description import BusDescription
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError

from sim_bridge.plant.simulation import PlantBlock, Simulation
from sim_bridge.sensors import sensors


@dataclass(frozen=True)
class InstrumentReadings:
    """Readings of a block; body and odometry are None on a stand."""

    electrical: sensors.MeterReadings
    joints: sensors.JointReadings
    temperature: sensors.TemperatureReadings
    supply: sensors.SupplyReadings
    body: sensors.BodyReadings | None
    odometry: sensors.OdometryReadings | None


_Sensed = tuple[sensors.JointReadings, sensors.BodyReadings | None]


class Instruments:
    """Meter, joint sensors, IMU, feet and bench supply of a simulation.

    Noise comes from seed and does not depend on how the run is cut into blocks.
    """

    def __init__(self, simulation: Simulation, seed: int) -> None:
        plant, parameters = simulation.plant, simulation.drives.parameters
        meter, joints, temperature, supply, body = np.random.default_rng(seed).spawn(5)
        self.clock = sensors.DeviceClock.of(plant.meter)
        self._meter = sensors.Meter(plant, parameters, meter)
        self._joints = sensors.JointSensors(plant, parameters, joints)
        self._temperature = sensors.TemperatureSensors(plant, temperature)
        self._supply = sensors.SupplySensor(plant, supply)
        self._body = sensors.BodySensors(body) if simulation.world.floating else None
        self._sensed: list[_Sensed] = []

    def sense(self, block: PlantBlock) -> _Sensed:
        """Return readings of joints, IMU and feet for a part of the next block, before `read`."""
        body = None if self._body is None else self._body.read(block)
        self._sensed.append((self._joints.read(block), body))
        return self._sensed[-1]

    def read(self, block: PlantBlock) -> InstrumentReadings:
        """Return the readings of the next block; blocks follow each other without a gap."""
        if not self._sensed:
            self.sense(block)
        joints, body = zip(*self._sensed, strict=True)
        self._sensed = []
        return InstrumentReadings(
            electrical=self._meter.read(block),
            joints=_joined(joints),
            temperature=self._temperature.read(block),
            supply=self._supply.read(block),
            body=None if self._body is None else _joined(body),
            odometry=None if self._body is None else sensors.read_odometry(block),
        )


def _joined(parts: Sequence[Any]) -> Any:
    """Return readings that follow each other as one."""
    if len(parts) == 1:
        return parts[0]
    kind = type(parts[0])
    names = [entry.name for entry in fields(kind)]
    return kind(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


class BusColumns:
    """Indices of D joints among the B drives of a bus; InputError for one that it lacks."""

    def __init__(self, bus: BusDescription, joints: Sequence[str]) -> None:
        for joint in joints:
            if joint not in bus.drives:
                raise InputError(f'joint {joint!r} is not on the bus; {", ".join(bus.drives)} are')
        self._count = len(bus.drives)
        self.places = [bus.drives.index(joint) for joint in joints]

    def spread(self, values: NDArray[np.generic]) -> Floats:
        """Return values of the joints [N, D] as those of all drives [N, B], 0 for the others."""
        wide = np.zeros((len(values), self._count))
        wide[:, self.places] = values
        return wide
