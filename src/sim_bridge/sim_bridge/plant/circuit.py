"""
Electric circuit from motor torque and speed to the power at each drive's DC link.

The motor is its equivalent in the rotor's frame: a torque-forming and a field-weakening current
through the winding's resistance, behind the voltage that rotation induces.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from sim_bridge.plant.parameters import Plant

Floats = NDArray[np.float64]
REFERENCE_TEMPERATURE: Final = 25.0  # °C at which resistances are given
_IDLE_CONSTANT_CURRENT: Final = 0.3  # share of the idle draw that grows with the voltage
_TINY: Final = 1e-9


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
        self._reactance = p['reactance'] / root
        self._most_weakening = p['weakening_current'] * root
        self._hysteresis = p['hysteresis'] * effects.iron_loss.scale
        self._eddy = p['eddy'] * effects.iron_loss.scale
        self._inverter = effects.inverter_loss.scale
        self._idle = p['idle_power'] * effects.idle.scale
        self._fan = p['fan'] * effects.fan.scale
        self._nominal = plant.supply.voltage
        efficiency = effects.regeneration_efficiency.scale
        self._lost_back = np.clip((1.0 - p['regeneration_efficiency']) * efficiency, 0.0, 1.0)
        self._phase = np.linspace(0.0, 1.0, len(names), endpoint=False) ** 2 + 0.5
        self.temperature = Windings(p, plant)

    def resistance(self) -> Floats:
        """Return the resistance of the windings at their temperature, ohm [D]."""
        warm = 1.0 + self._heating * (self.temperature.winding - REFERENCE_TEMPERATURE)
        resistance: Floats = self._p['resistance'] * self._copper * warm
        return resistance

    def solve(
        self, motor: Floats, speed: Floats, drag: Floats, voltage: float, time: Floats
    ) -> Flow:
        """
        Return currents and losses of B steps.

        motor: air-gap torque, N·m [B, D]; speed: rotor, rad/s [B, D], mean of the step;
        drag: friction, N·m [B, D], which warms the housing; voltage: the bus as the drives last
        read it, V; time: s [B], since the start.
        """
        p = self._p
        pull = motor / p['torque_limit']
        constant = p['torque_constant'] / (1.0 + p['saturation'] * pull * pull)
        fast = np.abs(speed)
        iron = self._iron_loss(fast)
        induced = constant * speed
        drag_current = iron * speed / (constant * (fast * fast + _TINY))
        iron = drag_current * induced
        current = motor / constant + drag_current
        resistance = self.resistance()
        weakening = self._weakening_current(current, fast, constant, voltage)
        through = np.sqrt(current * current + weakening * weakening)
        copper = resistance * current * current
        field = resistance * weakening * weakening
        drive_voltage = resistance * current + induced
        inverter = (
            self._inverter
            * through
            * (
                p['device_drop']
                + p['device_resistance'] * through
                + p['switching_share'] * voltage
            )
        )
        bridge = drive_voltage * current + field + inverter
        lost = self._lost_back * np.maximum(-bridge, 0.0)
        level = (1.0 - _IDLE_CONSTANT_CURRENT) + _IDLE_CONSTANT_CURRENT * voltage / self._nominal
        idle = np.broadcast_to(self._idle * level, motor.shape)
        fan = self._fan_power(time)
        self.temperature.heat(copper + field, 0.5 * (iron + inverter) + idle + drag * speed)
        return Flow(
            bridge + lost + idle + fan, copper, iron, inverter, field, idle, fan, lost, current
        )

    def _iron_loss(self, fast: Floats) -> Floats:
        if not self._hysteresis.any() and not self._eddy.any():
            return np.zeros_like(fast)
        p = self._p
        loss: Floats = self._hysteresis * fast ** p['hysteresis_exponent']
        loss += self._eddy * fast ** p['eddy_exponent']
        return loss

    def _weakening_current(
        self, current: Floats, fast: Floats, constant: Floats, voltage: float
    ) -> Floats:
        """Return the current that keeps the motor's voltage below the bus voltage, A."""
        p = self._p
        available = p['modulation'] * voltage
        needed = constant * fast + p['resistance'] * np.abs(current)
        if not self._weakening or not (needed > 0.8 * available).any():
            return np.zeros_like(fast)
        across = p['reactance'] * fast * current
        induced = np.sqrt(np.maximum(available**2 - across**2, 0.0))
        induced -= p['resistance'] * np.abs(current)
        excess = np.maximum(constant - induced / np.maximum(fast, 0.1), 0.0)
        return np.minimum(excess / self._reactance, self._most_weakening)

    def _fan_power(self, time: Floats) -> Floats:
        if not self._fan.any():
            return np.zeros((len(time), len(self._fan)))
        turn = (time[:, None] / self._p['fan_period'] + self._phase) % 1.0
        running = 1.0 / (1.0 + np.exp(-80.0 * (turn - 0.55)))
        running -= 1.0 / (1.0 + np.exp(-80.0 * (turn - 0.97)))
        power: Floats = self._fan * running
        return power


class Windings:
    """Thermal model of each drive: winding and housing as two heat capacities in series."""

    def __init__(self, parameters: dict[str, Floats], plant: Plant) -> None:
        self._p = parameters
        self._air = plant.sensors.ambient
        self.winding = np.full_like(parameters['resistance'], self._air)
        self.winding += plant.sensors.initial_rise
        self.housing = self.winding.copy()
        self._into_winding = np.zeros_like(self.winding)
        self._into_housing = np.zeros_like(self.winding)

    def heat(self, winding: Floats, housing: Floats) -> None:
        """Accumulate the heat of B steps, W [B, D]."""
        self._into_winding += winding.sum(axis=0)
        self._into_housing += housing.sum(axis=0)

    def settle(self, step: float, steps: int) -> None:
        """Update temperatures by the heat of a number of steps of step seconds."""
        p, time = self._p, step * steps
        between = p['winding_conductance'] * (self.winding - self.housing) * time
        outwards = p['housing_conductance'] * (self.housing - self._air) * time
        self.winding += (self._into_winding * step - between) / p['winding_capacity']
        self.housing += (self._into_housing * step + between - outwards) / p['housing_capacity']
        self._into_winding[:] = 0.0
        self._into_housing[:] = 0.0
