"""Supply side: bench supply behind a diode, bus with capacitor and brake choppers, cables."""

from dataclasses import dataclass
from math import sqrt
from typing import Final

import numpy as np
from wattwalk_core.arrays import Floats

from sim_bridge.plant.circuit_steps import bus_steps
from sim_bridge.plant.parameters import Plant

_LEAST_RESISTANCE: Final = 1e-4  # ohm of a supply without line resistance


@dataclass(frozen=True)
class BusFlow:
    """Power flow between supply and drives in B steps, as means over each step."""

    voltage: Floats  # V [B], at the power meter
    supply_current: Floats  # A [B], out of the supply into the drives
    supply_loss: Floats  # W [B], between supply and power board
    capacitor_loss: Floats  # W [B], series resistance of the capacitor
    stored: Floats  # W [B], into the capacitor
    power: Floats  # W [B, D], at the power meter, positive = drawn by the drive
    line: Floats  # W [B, D], cables between meter and drives
    burned: Floats  # W [B, D], brake choppers, by the drive that regenerated


class Bus:
    """
    DC bus shared by all drives, solved by an implicit step at each time step.

    Power cannot pass the diode backwards: what the drives together give back first charges the
    capacitor, and once its voltage has risen by the choppers' margin, brake resistors burn the
    rest. With `brake_in_drives` they sit in the drives, behind the meter, and each drive that
    gives back burns its share; else one sits on the bus, where the meter does not see it.
    """

    def __init__(self, plant: Plant, parameters: dict[str, Floats], step: float) -> None:
        line = plant.effects.line_resistance.scale
        supply = plant.supply
        self._source = supply.voltage
        inside = supply.battery_resistance * plant.effects.battery.scale
        self._resistance = max(supply.resistance * line + inside, _LEAST_RESISTANCE)
        self._capacity = supply.capacitance / step
        self._ceiling = supply.voltage + supply.chopper_rise
        self._blocked = min(plant.effects.regeneration_limit.scale, 1.0)
        self._in_drives = supply.brake_in_drives
        self._line: Floats = parameters['line_resistance'] * line
        self.voltage = supply.voltage

    def solve(self, link: Floats) -> BusFlow:
        """Advance by B steps with power drawn by the drives' DC links, W [B, D]."""
        series, powers = np.empty((5, len(link))), np.empty((3, *link.shape))
        self.voltage = bus_steps(
            np.ascontiguousarray(link),
            self._line,
            self.voltage,
            self._capacity,
            1.0 / self._resistance,
            self._source,
            self._ceiling,
            self._blocked,
            self._in_drives,
            series,
            powers,
        )
        return BusFlow(*series, *powers)


class Electronics:
    """Power of computers and sensors: a mean with slow variation (first-order Gauss-Markov)."""

    def __init__(self, plant: Plant, random: np.random.Generator, step: float) -> None:
        supply = plant.supply
        self._mean, self._width = supply.electronics, supply.electronics_variation
        self._keep = float(np.exp(-step / supply.electronics_time))
        self._random = random
        self._away = 0.0

    def draw(self, count: int) -> Floats:
        """Return the power at the next count steps, W [count]."""
        kicks = self._random.standard_normal(count) * self._width * sqrt(1.0 - self._keep**2)
        power = np.empty(count)
        for index, kick in enumerate(kicks.tolist()):
            self._away = self._keep * self._away + kick
            power[index] = max(self._mean + self._away, 0.0)
        return power
