"""Energy balance of the plant: energy supplied, work, losses and storage."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
from sim_bridge.plant.drive_steps import FRICTION
from sim_bridge.plant.simulation import STEP, Simulation

STORED = ('rotor', 'spring', 'capacitor', 'cogging_field')


@dataclass
class EnergyBalance:
    """
    Energy counters since the start, J, summed over all drives, by channel.

    `supply` is the energy from the supply to the drives, electronics excluded. `shaft` is the work
    at the joints, the channels STORED are changes of stored energy, all others are losses.
    """

    energy: dict[str, float] = field(default_factory=dict)

    def add(self, powers: Mapping[str, float], step: float) -> None:
        """Add sums of powers over steps, W, of step seconds each."""
        for name, power in powers.items():
            self.energy[name] = self.energy.get(name, 0.0) + power * step

    @property
    def supplied(self) -> float:
        """Energy from the supply, J."""
        return self.energy.get('supply', 0.0)

    @property
    def losses(self) -> dict[str, float]:
        """Energy turned into heat, J by channel."""
        outside = ('supply', 'shaft', *STORED)
        return {name: value for name, value in self.energy.items() if name not in outside}

    @property
    def residual(self) -> float:
        """Supplied energy that no channel accounts for, J."""
        return self.supplied - sum(v for name, v in self.energy.items() if name != 'supply')

    @property
    def turnover(self) -> float:
        """The larger of the energy supplied and the energy exchanged by the channels, J."""
        spent = sum(abs(value) for name, value in self.energy.items() if name != 'supply')
        return max(abs(self.supplied), spent)


class BalancedSimulation(Simulation):
    """A simulation with the energy balance of its plant."""

    def __init__(self, *arguments, **options):
        self.energy_balance = EnergyBalance()
        super().__init__(*arguments, **options)

    def _draw(self, rows):
        super()._draw(rows)
        drives, trace, flow, bus = self.drives, self.drives.trace, self.flow, self.bus_flow
        speed, rotor_speed, acceleration = self._rates(rows)
        spring = damper = np.zeros_like(speed)
        if drives.elastic:
            twisting = rotor_speed - speed
            joint = self._qvel[rows, -len(self.joints) :]
            damper = drives.damping * (trace.velocity[rows] - joint) * twisting
            spring = trace.output[rows] * twisting - damper
        drag = friction_parts(
            drives.friction, trace.position[rows], trace.velocity[rows], trace.motor[rows]
        )
        powers = {
            'supply': self.plant.supply.voltage * bus.supply_current,
            'supply_line': bus.supply_loss,
            'capacitor_resistance': bus.capacitor_loss,
            'capacitor': bus.stored,
            'line_resistance': bus.line,
            'regeneration_limit': bus.burned,
            'regeneration_efficiency': flow.regeneration,
            'idle': flow.idle,
            'fan': flow.fan,
            'inverter_loss': flow.inverter,
            'iron_loss': flow.iron,
            'copper_loss': flow.copper,
            'field_weakening': flow.weakening,
            **{name: part * rotor_speed for name, part in drag.items()},
            'cogging_field': trace.cogging[rows] * rotor_speed,
            'rotor': drives.inertia * acceleration * rotor_speed,
            'spring': spring,
            'spring_damping': damper,
            'shaft': self._torque[rows] * speed,
        }
        self.energy_balance.add({name: float(power.sum()) for name, power in powers.items()}, STEP)


def friction_parts(friction, position, velocity, motor):
    """Return the drag of `friction_torque` by effect, N·m [..., D] each."""
    f = SimpleNamespace(**dict(zip(FRICTION, friction, strict=True)))
    sign = np.tanh(velocity * f.slope)
    fade = 1.0 + (velocity * f.fade) ** 2
    away = (np.abs(position) - f.rub_angle) / f.rub_width
    return {
        'coulomb_friction': f.coulomb * sign,
        'stribeck_friction': f.stribeck / fade**2 * sign,
        'load_friction': (f.load * np.abs(motor) + f.asymmetry * motor * sign) * sign,
        'viscous_friction': f.viscous * velocity / (1.0 + np.abs(velocity) * f.thin),
        'position_rub': f.rub / (1.0 + away**2) ** 2 * sign,
    }
