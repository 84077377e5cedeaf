"""Supply side: bench supply behind a diode, bus with capacitor and brake choppers, cables."""

from dataclasses import dataclass
from math import sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from sim_bridge.plant.parameters import Plant

Floats = NDArray[np.float64]
_LEAST_RESISTANCE: Final = 1e-4  # ohm of a supply without line resistance


@dataclass(frozen=True)
class BusFlow:
    """Power flow between supply and drives in B steps, as means over each step."""

    voltage: Floats  # V [B], at the power meter
    power: Floats  # W [B, D], at the power meter, positive = drawn by the drive
    line: Floats  # W [B, D], cables between meter and drives
    burned: Floats  # W [B, D], brake choppers, by the drive that regenerated
    supply_current: Floats  # A [B], out of the supply into the drives
    supply_loss: Floats  # W [B], between supply and power board
    capacitor_loss: Floats  # W [B], series resistance of the capacitor
    stored: Floats  # W [B], into the capacitor


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
        self._resistance = max(supply.resistance * line, _LEAST_RESISTANCE)
        self._capacity = supply.capacitance / step
        self._ceiling = supply.voltage + supply.chopper_rise
        self._blocked = min(plant.effects.regeneration_limit.scale, 1.0)
        self._in_drives = supply.brake_in_drives
        self._line: Floats = parameters['line_resistance'] * line
        self.voltage = supply.voltage

    def solve(self, link: Floats) -> BusFlow:
        """Advance by B steps with power drawn by the drives' DC links, W [B, D]."""
        before = self.voltage
        line = self._line_loss(link, np.full((len(link), 1), before))
        first, _, _ = self._settle((link + line).sum(axis=1).tolist())
        line = self._line_loss(link, np.array(first)[:, None])
        self.voltage = before
        power = link + line
        voltages, burns, currents = self._settle(power.sum(axis=1).tolist())
        voltage, burn, current = np.array(voltages), np.array(burns), np.array(currents)
        if burn.any():
            back = np.maximum(-power, 0.0)
            share = back / np.maximum(back.sum(axis=1, keepdims=True), 1e-12)
            burned = burn[:, None] * share
            if self._in_drives:
                power = power + burned
        else:
            burned = np.zeros_like(power)
        change = np.diff(voltage, prepend=before)
        return BusFlow(
            voltage=voltage,
            power=power,
            line=line,
            burned=burned,
            supply_current=current,
            supply_loss=(self._source - voltage) * current,
            capacitor_loss=0.5 * self._capacity * change**2,
            stored=self._capacity * change * (voltage - 0.5 * change),
        )

    def _line_loss(self, link: Floats, voltage: Floats) -> Floats:
        root = np.sqrt(np.maximum(voltage**2 - 4.0 * self._line * link, 0.0))
        loss: Floats = self._line * (2.0 * link / (voltage + root)) ** 2
        return loss

    def _settle(self, totals: list[float]) -> tuple[list[float], list[float], list[float]]:
        voltages, burns, currents = [], [], []
        for total in totals:
            voltage, burn, current = self._advance(total)
            self.voltage = voltage
            voltages.append(voltage)
            burns.append(burn)
            currents.append(current)
        return voltages, burns, currents

    def _advance(self, power: float) -> tuple[float, float, float]:
        capacity, source = self._capacity, self._source
        conductance = 1.0 / self._resistance
        a = capacity + conductance
        b = capacity * self.voltage + conductance * source
        voltage = (b + sqrt(max(b * b - 4.0 * a * power, 0.0))) / (2.0 * a)
        if voltage <= source or not self._blocked:
            return voltage, 0.0, (source - voltage) * conductance
        kept = self._blocked * power if power < 0.0 else power
        b = capacity * self.voltage
        voltage = (b + sqrt(max(b * b - 4.0 * capacity * kept, 0.0))) / (2.0 * capacity)
        burn = 0.0
        if voltage > self._ceiling:
            voltage = self._ceiling
            burn = max(-kept - voltage * capacity * (voltage - self.voltage), 0.0)
        return voltage, burn, (power - kept) / voltage


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
