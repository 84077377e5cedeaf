"""Sensors of drives, base, feet and bench supply."""

from dataclasses import dataclass
from math import ceil, exp, pi
from typing import Final

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.anymal import GRAVITY
from wattwalk_core.arrays import Floats

from sim_bridge.plant.circuit import Electronics
from sim_bridge.plant.parameters import MeterParameters, Plant
from sim_bridge.plant.simulation import JOINT_PERIOD, STEP, PlantBlock

METER_PERIOD: Final = 2  # steps between samples: 1 kHz
_PIECE: Final = 64  # steps filtered at once
UNDERRANGE: Final = 1
OVERRANGE: Final = 2


class LowPass:
    """First-order low-pass filter of several channels, with its state kept between blocks."""

    def __init__(self, bandwidth: float, start: Floats) -> None:
        """Make a filter; bandwidth: −3 dB, Hz; start: values before the first step [channels]."""
        keep = exp(-2.0 * pi * bandwidth * STEP)
        age = np.arange(_PIECE)[:, None] - np.arange(_PIECE)
        self._answer = np.where(age >= 0, (1.0 - keep) * keep ** np.maximum(age, 0), 0.0)
        self._decay = keep ** np.arange(1.0, _PIECE + 1.0)[:, None]
        self._state = np.array(start, dtype=np.float64)

    def __call__(self, values: Floats) -> Floats:
        """Return the next steps [B, channels] filtered."""
        result = np.empty_like(values)
        for first in range(0, len(values), _PIECE):
            piece = values[first : first + _PIECE]
            count = len(piece)
            filtered = self._answer[:count, :count] @ piece + self._decay[:count] * self._state
            result[first : first + count] = filtered
            self._state = filtered[-1]
        return result


class FractionalDelay:
    """Delay by a fractional number of steps, with its state kept between blocks."""

    def __init__(self, steps: float, start: Floats) -> None:
        self._whole = int(steps)
        self._part = steps - self._whole
        self._past = np.tile(np.asarray(start, dtype=np.float64), (ceil(steps) + 1, 1))

    def __call__(self, values: Floats) -> Floats:
        """Return the values [B, channels] delayed by `steps`; `start` precedes the first."""
        series = np.vstack((self._past, values))
        count, past = len(values), len(self._past)
        late = series[past - self._whole :][:count]
        later = series[past - self._whole - 1 :][:count]
        self._past = series[-past:]
        return late + self._part * (later - late)


@dataclass(frozen=True)
class DeviceClock:
    """Clock of the device, which times the steps, with offset and drift.

    offset: reading at step 0, s. drift: how much too fast it runs, ppm.
    """

    offset: float
    drift: float

    @classmethod
    def of(cls, meter: MeterParameters) -> 'DeviceClock':
        """Return the clock of a power meter."""
        return cls(meter.clock_offset, meter.clock_drift)

    def device_ns(self, step: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the device time at the end of step − 1, ns, without wrapping."""
        return np.asarray(step * round(STEP * 1e9) + round(self.offset * 1e9))

    def elapsed_ns(self, step: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the true time since step 0, ns."""
        return np.rint(step * (STEP * 1e9) / (1.0 + 1e-6 * self.drift)).astype(np.int64)


@dataclass(frozen=True)
class MeterReadings:
    """N samples of D drives after the meter's converters."""

    step: NDArray[np.int64]  # [N] steps since the start
    voltage: Floats  # V [N, D]
    current: Floats  # A [N, D]
    status: NDArray[np.uint8]  # [N, D]: 0, or UNDERRANGE and OVERRANGE


class Meter:
    """Power meter of D drives: filter, delay, sampling, noise and converter."""

    def __init__(self, plant: Plant, parameters: dict[str, Floats], random: np.random.Generator):
        meter = plant.meter
        self._meter = meter
        self._voltage_gain = parameters['voltage_gain']
        self._current_gain = parameters['current_gain']
        self._current_offset = parameters['current_offset']
        drives = len(self._current_gain)
        cross = meter.cross_talk * plant.effects.cross_talk.scale
        self._mix = np.eye(drives)
        if drives > 1:
            self._mix += cross * np.roll(np.eye(drives), 1, axis=0)
        start = np.append(np.zeros(drives), plant.supply.voltage)
        slow = plant.effects.meter_filter.scale
        self._filter = LowPass(meter.slow_bandwidth / slow if slow else meter.bandwidth, start)
        self._delay = FractionalDelay(meter.delay / STEP - 0.5, start)
        self._random = random

    def read(self, block: PlantBlock) -> MeterReadings:
        """Return the readings of a block; blocks must follow each other without a gap."""
        steps, rows = due_steps(block, METER_PERIOD)
        signals = np.column_stack((block.current, block.voltage))
        signals = self._delay(self._filter(signals))[rows]
        meter, drives = self._meter, signals.shape[1] - 1
        noise = self._random.standard_normal((len(signals), 2, drives))
        voltage = signals[:, drives:] * self._voltage_gain + meter.voltage_noise * noise[:, 0]
        current = (signals[:, :drives] @ self._mix) * self._current_gain + self._current_offset
        current += meter.current_noise * noise[:, 1]
        under = (voltage < 0.0) | (current < -meter.current_range)
        over = (voltage > meter.voltage_range) | (current > meter.current_range)
        status = (UNDERRANGE * under + OVERRANGE * over).astype(np.uint8)
        levels = 2**meter.bits
        return MeterReadings(
            step=steps,
            voltage=_digitise(voltage, 0.0, meter.voltage_range, levels),
            current=_digitise(current, -meter.current_range, meter.current_range, levels),
            status=status,
        )


def _digitise(values: Floats, low: float, high: float, levels: int) -> Floats:
    size = (high - low) / levels
    return low + np.clip(np.rint((values - low) / size), 0, levels - 1) * size


Steps = NDArray[np.int64]
TEMPERATURE_PERIOD: Final = 200  # steps: 10 Hz
SUPPLY_PERIOD: Final = 20  # steps: 100 Hz
_NOTHING = np.zeros(0)
_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])
_IMU_BANDWIDTH: Final = 150.0  # Hz
_REVERSAL: Final = 4.0  # half widths of torque over which hysteresis turns round
_ACCELERATION_NOISE, _RATE_NOISE, _FORCE_NOISE = 0.03, 0.003, 1.0  # m/s², rad/s, N


def due_steps(block: PlantBlock, period: int) -> tuple[Steps, Steps]:
    """Return a block's steps that are multiples of a period, and their rows in it, [N] each."""
    first = -(-(block.first + 1) // period) * period
    steps = np.arange(first, block.first + block.steps + 1, period)
    return steps, steps - block.first - 1


@dataclass(frozen=True)
class JointReadings:
    """N samples at 400 Hz of D joints."""

    step: Steps  # [N]
    position: Floats  # rad [N, D]
    velocity: Floats  # rad/s [N, D]
    torque: Floats  # N·m [N, D]


class JointSensors:
    """Encoder, filtered speed and torque sensor of each joint."""

    def __init__(self, plant: Plant, parameters: dict[str, Floats], random: np.random.Generator):
        self._sensors = plant.sensors
        self._bias = parameters['torque_bias']
        self._limit = parameters['torque_limit']
        self._filter = LowPass(plant.sensors.velocity_bandwidth, np.zeros_like(self._bias))
        self._eccentricity = plant.sensors.eccentricity * plant.effects.encoder_eccentricity.scale
        self._hysteresis = plant.sensors.torque_hysteresis * plant.effects.torque_hysteresis.scale
        self._slip, self._load = np.zeros_like(self._bias), np.zeros_like(self._bias)
        self._random = random

    def read(self, block: PlantBlock) -> JointReadings:
        """Return the readings of a block; blocks must follow each other without a gap."""
        sensors = self._sensors
        steps, rows = due_steps(block, JOINT_PERIOD)
        noise = self._random.standard_normal((len(rows), 3, len(self._bias)))
        speed = self._filter(block.velocity)[rows]
        torque, position = block.torque[rows], block.position[rows]
        if self._eccentricity:
            speed = speed * (1.0 + self._eccentricity * np.cos(position))
            position = position + self._eccentricity * np.sin(position)
        late = self._lag_behind(torque) if self._hysteresis else 0.0
        bend = 1.0 + sensors.torque_gain_error + sensors.torque_bend * np.abs(torque) / self._limit
        return JointReadings(
            step=steps,
            position=position + sensors.position_noise * noise[:, 0],
            velocity=speed + sensors.velocity_noise * noise[:, 1],
            torque=torque * bend + late + self._bias + sensors.torque_noise * noise[:, 2],
        )

    def _lag_behind(self, torque: Floats) -> Floats:
        """Return what hysteresis adds to torques [N, D], half its width once they have turned."""
        added, reach = np.empty_like(torque), _REVERSAL * self._hysteresis
        for row, load in enumerate(torque):
            self._slip = np.clip(self._slip + (load - self._load) / reach, -1.0, 1.0)
            self._load = load
            added[row] = self._hysteresis * self._slip
        return added


@dataclass(frozen=True)
class TemperatureReadings:
    """N samples at 10 Hz of the windings of D drives."""

    step: Steps  # [N]
    temperature: Floats  # °C [N, D]


class TemperatureSensors:
    """Temperature sensors of the windings."""

    def __init__(self, plant: Plant, random: np.random.Generator) -> None:
        self._noise = plant.sensors.temperature_noise
        self._random = random

    def read(self, block: PlantBlock) -> TemperatureReadings:
        """Return the readings of a block; its temperature is that at the end."""
        steps, _ = due_steps(block, TEMPERATURE_PERIOD)
        noise = self._random.standard_normal((len(steps), len(block.temperature)))
        return TemperatureReadings(steps, block.temperature + self._noise * noise)


@dataclass(frozen=True)
class BodyReadings:
    """N samples at 400 Hz of IMU and feet."""

    step: Steps  # [N]
    orientation: Floats  # x y z w [N, 4]
    rate: Floats  # rad/s [N, 3], base frame
    acceleration: Floats  # m/s² [N, 3], base frame, with gravity
    foot_force: Floats  # N [N, 4]


class BodySensors:
    """IMU at the base and force sensors in the feet."""

    def __init__(self, random: np.random.Generator) -> None:
        self._filter = LowPass(_IMU_BANDWIDTH, np.zeros(3))
        self._random = random

    def read(self, block: PlantBlock) -> BodyReadings:
        """Return the readings of a block; blocks must follow each other without a gap."""
        steps, rows = due_steps(block, JOINT_PERIOD)
        noise = self._random.standard_normal((len(rows), 10))
        felt = self._filter(block.acceleration)[rows] + np.array([0.0, 0.0, GRAVITY])
        attitude = block.base[rows, 3:7]
        force = block.foot_force + _FORCE_NOISE * noise[:, 6:]
        return BodyReadings(
            step=steps,
            orientation=np.roll(attitude, -1, axis=1),
            rate=block.base[rows, 10:13] + _RATE_NOISE * noise[:, :3],
            acceleration=into_base(attitude, felt) + _ACCELERATION_NOISE * noise[:, 3:6],
            foot_force=np.maximum(force, 0.0),
        )


@dataclass(frozen=True)
class OdometryReadings:
    """N samples at 100 Hz of the base's pose and twist."""

    step: Steps  # [N]
    position: Floats  # m [N, 3], world
    orientation: Floats  # x y z w [N, 4]
    velocity: Floats  # m/s [N, 3], base frame
    rate: Floats  # rad/s [N, 3], base frame


_NO_STEPS: Final = np.zeros(0, np.int64)
_NO_ODOMETRY: Final = OdometryReadings(_NO_STEPS, *(np.zeros((0, n)) for n in (3, 4, 3, 3)))


def read_odometry(block: PlantBlock) -> OdometryReadings:
    """Return the true pose and twist of the base, 100 Hz."""
    steps, rows = due_steps(block, SUPPLY_PERIOD)
    if not len(steps):
        return _NO_ODOMETRY
    base = block.base[rows]
    return OdometryReadings(
        step=steps,
        position=base[:, :3],
        orientation=np.roll(base[:, 3:7], -1, axis=1),
        velocity=into_base(base[:, 3:7], base[:, 7:10]),
        rate=base[:, 10:13],
    )


@dataclass(frozen=True)
class SupplyReadings:
    """N readings at 100 Hz of the bench supply, 10 ms means; current is negative while drawing."""

    step: Steps  # [N] since the start, of STEP
    voltage: Floats  # V [N]
    current: Floats  # A [N]


class SupplySensor:
    """Sensor of the bench supply: voltage and current of drives and electronics, 10 ms means."""

    def __init__(self, plant: Plant, random: np.random.Generator) -> None:
        self._supply = plant.supply
        self._electronics = Electronics(plant, random.spawn(1)[0], STEP * SUPPLY_PERIOD)
        self._random = random
        self._pending = np.zeros(0)

    def read(self, block: PlantBlock) -> SupplyReadings:
        """Return the readings of a block; blocks must follow each other without a gap."""
        supply = self._supply
        steps, _ = due_steps(block, SUPPLY_PERIOD)
        drawn = np.concatenate((self._pending, block.supply_current))
        whole = SUPPLY_PERIOD * len(steps)
        if not whole:
            self._pending = drawn
            return SupplyReadings(steps, _NOTHING, _NOTHING)
        self._pending = drawn[whole:]
        drives = drawn[:whole].reshape(-1, SUPPLY_PERIOD).mean(axis=1)
        electronics = self._electronics.draw(len(steps)) / supply.voltage
        noise = self._random.standard_normal((len(steps), 2))
        return SupplyReadings(
            step=steps,
            voltage=supply.voltage + supply.voltage_noise * noise[:, 0],
            current=-(drives + electronics) + supply.current_noise * noise[:, 1],
        )


def into_base(attitude: Floats, vector: Floats) -> Floats:
    """Rotate world vectors [N, 3] into the base frame, given as quaternions w x y z [N, 4]."""
    scalar, axis = attitude[:, :1], -attitude[:, 1:]
    twist = 2.0 * _cross(axis, vector)
    return vector + scalar * twist + _cross(axis, twist)


def _cross(a: Floats, b: Floats) -> Floats:
    product: Floats = a.take(_NEXT, 1) * b.take(_LAST, 1)
    product -= a.take(_LAST, 1) * b.take(_NEXT, 1)
    return product
