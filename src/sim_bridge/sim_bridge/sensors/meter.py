"""Power meter: filters, delay, sampling errors and device clock."""

from dataclasses import dataclass
from math import ceil, exp, pi
from typing import Final

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.arrays import Floats

from sim_bridge.plant.parameters import MeterParameters, Plant
from sim_bridge.plant.simulation import STEP, PlantBlock

METER_PERIOD: Final = 2  # steps between samples: 1 kHz
_PIECE: Final = 64  # steps filtered at once
UNDERRANGE: Final = 1
OVERRANGE: Final = 2


class LowPass:
    """First-order low-pass filter of several channels, with its state kept between blocks."""

    def __init__(self, bandwidth: float, start: Floats) -> None:
        """bandwidth: −3 dB, Hz; start: value of each channel before the first step."""
        keep = exp(-2.0 * pi * bandwidth * STEP)
        age = np.arange(_PIECE)[:, None] - np.arange(_PIECE)
        self._answer = np.where(age >= 0, (1.0 - keep) * keep ** np.maximum(age, 0), 0.0)
        self._decay = keep ** np.arange(1.0, _PIECE + 1.0)[:, None]
        self._state = np.array(start, dtype=np.float64)

    def __call__(self, values: Floats) -> Floats:
        """Return the next steps filtered, [B, channels]."""
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
        """Return the delayed values, [B, channels]."""
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
        shown: NDArray[np.int64] = np.asarray(step) * round(STEP * 1e9) + round(self.offset * 1e9)
        return shown

    def elapsed_ns(self, step: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the true time since step 0, ns."""
        nominal = np.asarray(step) * (STEP * 1e9)
        return np.rint(nominal / (1.0 + 1e-6 * self.drift)).astype(np.int64)


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
        signals = np.column_stack((block.current, block.voltage))
        signals = self._delay(self._filter(signals))
        step = np.arange(block.first + 1, block.first + block.steps + 1)
        due = step % METER_PERIOD == 0
        signals = signals[due]
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
            step=step[due],
            voltage=_digitise(voltage, 0.0, meter.voltage_range, levels),
            current=_digitise(current, -meter.current_range, meter.current_range, levels),
            status=status,
        )


def _digitise(values: Floats, low: float, high: float, levels: int) -> Floats:
    size = (high - low) / levels
    counts = np.clip(np.rint((values - low) / size), 0, levels - 1)
    return low + counts * size
