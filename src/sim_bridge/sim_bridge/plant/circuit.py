"""Electric circuit from motor torque and speed to the power at each drive's DC link.

The motor is its equivalent in the rotor's frame: a torque-forming and a field-weakening current
through the winding's resistance, behind the voltage that rotation induces.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Final

import numpy as np
from wattwalk_core.arrays import Floats

from sim_bridge.plant.circuit_steps import bus_steps, circuit_steps
from sim_bridge.plant.parameters import Plant

REFERENCE_TEMPERATURE: Final = 25.0  # °C at which resistances are given
_DIODE: Final = 0.9  # V, through which the current flows while both switches are open
_IDLE_CONSTANT_CURRENT: Final = 0.3  # share of the idle draw that grows with the voltage


@dataclass(frozen=True)
class Flow:
    """Powers of B steps, W [B, D] each unless stated otherwise."""

    link: Floats  # drawn at the drive's DC link
    copper: Floats
    iron: Floats
    inverter: Floats
    weakening: Floats
    idle: Floats
    fan: Floats
    regeneration: Floats  # lost on its way back to the link
    current: Floats  # A, torque-forming


class Circuit:
    """Windings, iron, inverters and electronics of D drives."""

    def __init__(self, plant: Plant, names: Sequence[str], parameters: dict[str, Floats]) -> None:
        p, effects = parameters, plant.effects
        self._p = p
        self._copper = effects.copper_loss.scale
        self._heating = p['temperature_coefficient'] * effects.winding_heating.scale
        self._weakening = effects.field_weakening.scale
        root = np.sqrt(self._weakening) if self._weakening else 1.0
        self._inverter = effects.inverter_loss.scale
        self._magnet = p['magnet_coefficient'] * effects.magnet_heating.scale
        dead = 2.0 * p['dead_time'] * effects.dead_time.scale
        self._nominal = plant.supply.voltage
        efficiency = effects.regeneration_efficiency.scale
        self._table = np.array(
            (
                p['torque_limit'],
                p['torque_constant'],
                p['saturation'],
                p['hysteresis'] * effects.iron_loss.scale,
                p['hysteresis_exponent'],
                p['eddy'] * effects.iron_loss.scale,
                p['eddy_exponent'],
                p['resistance'],
                p['modulation'],
                p['reactance'],
                p['reactance'] / root,
                p['weakening_current'] * root,
                p['device_drop'] + dead * _DIODE,
                p['device_resistance'],
                p['switching_share'],
                np.clip((1.0 - p['regeneration_efficiency']) * efficiency, 0.0, 1.0),
                p['idle_power'] * effects.idle.scale,
                p['fan'] * effects.fan.scale,
                p['fan_period'],
                np.linspace(0.0, 1.0, len(names), endpoint=False) ** 2 + 0.5,
            )
        )
        self.temperature = Windings(p, plant)

    def resistance(self) -> Floats:
        """Return the resistance of the windings at their temperature, ohm [D]."""
        warm = 1.0 + self._heating * (self.temperature.winding - REFERENCE_TEMPERATURE)
        return self._p['resistance'] * self._copper * warm

    def constant(self) -> Floats:
        """Return the torque constants at the temperature of the magnets, N·m/A [D]."""
        warm = self._magnet * (self.temperature.housing - REFERENCE_TEMPERATURE)
        return self._p['torque_constant'] * (1.0 - warm)

    def solve(
        self, motor: Floats, speed: Floats, drag: Floats, voltage: float, time: Floats
    ) -> Flow:
        """Return currents and losses of B steps; heat is added to `temperature.heat`.

        motor: air-gap torque, N·m [B, D]; speed: rotor, rad/s [B, D], mean of the step;
        drag: friction, N·m [B, D], which warms the housing; voltage: the bus as the drives last
        read it, V; time: s [B], since the start.
        """
        level = (1.0 - _IDLE_CONSTANT_CURRENT) + _IDLE_CONSTANT_CURRENT * voltage / self._nominal
        flow = np.empty((9, *motor.shape))
        self._table[1] = self.constant()
        circuit_steps(
            self._table,
            self.resistance(),
            np.ascontiguousarray(motor),
            np.ascontiguousarray(speed),
            np.ascontiguousarray(drag),
            time,
            voltage,
            level,
            self._inverter,
            bool(self._weakening),
            flow,
            self.temperature.heat,
        )
        return Flow(*flow)


class Windings:
    """Thermal model of each drive: winding and housing as two heat capacities in series."""

    def __init__(self, parameters: dict[str, Floats], plant: Plant) -> None:
        self._p = parameters
        self._air = plant.sensors.ambient
        self.winding = np.full_like(parameters['resistance'], self._air)
        self.winding += plant.sensors.initial_rise
        self.housing = self.winding.copy()
        self.heat = np.zeros((2, len(self.winding)))
        """Sums of powers into windings and housings since temperatures were updated, W [2, D]."""

    def settle(self, step: float, steps: int) -> None:
        """Update temperatures by the heat of a number of steps of step seconds."""
        p, time = self._p, step * steps
        between = p['winding_conductance'] * (self.winding - self.housing) * time
        outwards = p['housing_conductance'] * (self.housing - self._air) * time
        self.winding += (self.heat[0] * step - between) / p['winding_capacity']
        self.housing += (self.heat[1] * step + between - outwards) / p['housing_capacity']
        self.heat[:] = 0.0


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
    """DC bus shared by all drives, solved by an implicit step at each time step.

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
        """Return the power at the next `count` steps (of the constructor's `step`), W [count]."""
        kicks = self._random.standard_normal(count) * self._width * sqrt(1.0 - self._keep**2)
        power = np.empty(count)
        for index, kick in enumerate(kicks.tolist()):
            self._away = self._keep * self._away + kick
            power[index] = max(self._mean + self._away, 0.0)
        return power
