"""
The simulated hardware in numbers: supply, drives, effects, meter and joint sensors.

A plant is read from a YAML file; `docs/simulated_hardware.md` says where each figure comes from.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from wattwalk_core.errors import InputError

from sim_bridge.plant.config_fields import bounded, check, from_mapping, read_named
from sim_bridge.plant.effects import Effect, Effects

Floats = NDArray[np.float64]
PLANTS = Path(__file__).parents[1] / 'plants'


@dataclass(frozen=True)
class DriveParameters:
    """One type of drive, every quantity as seen at the joint (behind the gear)."""

    resistance: float = bounded(0.5, 0.01, 10.0, 'ohm', 'DC equivalent, at 25 °C')
    torque_constant: float = bounded(5.4, 0.1, 20.0, 'N·m/A', 'motor constant times gear')
    saturation: float = bounded(0.05, 0.0, 0.5, '', 'more current at full torque')
    reactance: float = bounded(0.08, 0.001, 1.0, 'V·s/(rad·A)', 'inductance times pole pairs')
    torque_limit: float = bounded(80.0, 1.0, 500.0, 'N·m', '')
    modulation: float = bounded(0.95, 0.5, 1.0, '', 'share of the bus voltage at the motor')
    weakening_current: float = bounded(10.0, 0.0, 50.0, 'A', 'most that opposes the magnets')
    temperature_coefficient: float = bounded(0.0039, 0.0, 0.01, '1/K', 'of the resistance')
    winding_capacity: float = bounded(60.0, 1.0, 1e4, 'J/K', '')
    winding_conductance: float = bounded(0.7, 0.01, 100.0, 'W/K', 'winding to housing')
    housing_capacity: float = bounded(850.0, 1.0, 1e5, 'J/K', '')
    housing_conductance: float = bounded(0.85, 0.01, 100.0, 'W/K', 'housing to air')
    coulomb: float = bounded(1.5, 0.0, 20.0, 'N·m', '')
    presliding_velocity: float = bounded(0.05, 0.005, 1.0, 'rad/s', 'where dry friction sets in')
    viscous: float = bounded(2.4, 0.0, 20.0, 'N·m·s/rad', 'at standstill')
    shear_velocity: float = bounded(
        40.0, 1.0, 1e3, 'rad/s', 'where the grease has thinned by half'
    )
    stribeck: float = bounded(0.8, 0.0, 20.0, 'N·m', 'on top of Coulomb, near standstill')
    stribeck_velocity: float = bounded(0.5, 0.02, 10.0, 'rad/s', '')
    load_friction: float = bounded(0.06, 0.0, 0.5, '', 'share of the torque lost in the gear')
    load_asymmetry: float = bounded(0.1, -0.9, 0.9, '', 'more when driving, less when driven')
    rotor_inertia: float = bounded(0.0675, 0.0, 1.0, 'kg·m²', 'rotor and gear')
    hysteresis: float = bounded(0.22, 0.0, 10.0, 'W', 'iron loss at 1 rad/s')
    hysteresis_exponent: float = bounded(1.15, 1.0, 2.0, '', '')
    eddy: float = bounded(0.05, 0.0, 10.0, 'W', 'iron loss at 1 rad/s')
    eddy_exponent: float = bounded(1.85, 1.0, 2.5, '', '')
    device_drop: float = bounded(0.25, 0.0, 5.0, 'V', 'of the conducting switches')
    device_resistance: float = bounded(0.02, 0.0, 1.0, 'ohm', 'of the conducting switches')
    switching_share: float = bounded(0.004, 0.0, 0.1, '', 'switching time times frequency')
    idle_power: float = bounded(8.2, 0.0, 100.0, 'W', 'electronics, at the nominal voltage')
    line_resistance: float = bounded(0.1, 0.0, 2.0, 'ohm', 'meter to drive, both wires')
    regeneration_efficiency: float = bounded(0.88, 0.0, 1.0, '', '')
    cogging: float = bounded(0.25, 0.0, 20.0, 'N·m', '')
    cogging_order: float = bounded(300.0, 1.0, 1e4, '', 'periods per turn of the joint')
    spring_stiffness: float = bounded(400.0, 50.0, 1e4, 'N·m/rad', 'gear to joint')
    spring_damping: float = bounded(2.5, 0.0, 20.0, 'N·m·s/rad', 'beside the spring')
    rub: float = bounded(4.0, 0.0, 20.0, 'N·m', 'at its worst angle')
    rub_angle: float = bounded(0.9, -10.0, 10.0, 'rad', 'size of the worst angle')
    rub_width: float = bounded(0.15, 0.01, 3.0, 'rad', '')
    fan: float = bounded(6.0, 0.0, 100.0, 'W', 'while it runs')
    fan_period: float = bounded(9.0, 0.5, 1e4, 's', '')


@dataclass(frozen=True)
class SupplyParameters:
    """Bench supply, diode, bus with capacitor and brake choppers, and the robot's computers."""

    voltage: float = bounded(48.0, 5.0, 800.0, 'V', 'of the supply without load')
    resistance: float = bounded(0.05, 0.0, 5.0, 'ohm', 'supply to power board')
    capacitance: float = bounded(0.012, 1e-4, 1.0, 'F', 'of the bus')
    chopper_rise: float = bounded(4.0, 0.5, 100.0, 'V', 'above the supply, where choppers hold')
    electronics: float = bounded(192.0, 0.0, 2e3, 'W', 'computers and sensors, mean')
    electronics_variation: float = bounded(5.0, 0.0, 500.0, 'W', 'standard deviation')
    electronics_time: float = bounded(6.0, 0.05, 1e4, 's', 'how slowly they vary')
    voltage_noise: float = bounded(0.01, 0.0, 5.0, 'V', 'of the supply reading')
    current_noise: float = bounded(0.02, 0.0, 5.0, 'A', 'of the supply reading')
    brake_in_drives: bool = True


@dataclass(frozen=True)
class MeterParameters:
    """The power meter: one voltage and one current channel per drive, read each ms."""

    voltage_noise: float = bounded(0.01, 0.0, 5.0, 'V', 'standard deviation')
    current_noise: float = bounded(0.025, 0.0, 5.0, 'A', 'standard deviation')
    voltage_range: float = bounded(65.0, 1.0, 1e3, 'V', 'full scale; below 0 is underrange')
    current_range: float = bounded(30.0, 0.1, 1e3, 'A', 'full scale, both signs')
    bits: int = bounded(16, 6, 24, 'bit', 'of the converter')
    voltage_gain_error: float = bounded(0.0, -0.2, 0.2, '', '')
    current_gain_error: float = bounded(0.0, -0.2, 0.2, '', '')
    current_offset: float = bounded(0.0, -5.0, 5.0, 'A', '')
    delay: float = bounded(0.4e-3, 0.25e-3, 20e-3, 's', 'signal to sample, beyond the filter')
    bandwidth: float = bounded(450.0, 5.0, 900.0, 'Hz', 'first-order filter before the converter')
    cross_talk: float = bounded(0.05, -0.5, 0.5, '', "share of the neighbour's current")
    clock_offset: float = bounded(0.0, 0.0, 1e5, 's', 'device clock at the start')
    clock_drift: float = bounded(18.0, -500.0, 500.0, 'ppm', 'of the device clock')


@dataclass(frozen=True)
class SensorParameters:
    """What the drives report of the joint."""

    position_noise: float = bounded(2e-4, 0.0, 0.1, 'rad', 'standard deviation')
    velocity_noise: float = bounded(0.01, 0.0, 1.0, 'rad/s', 'standard deviation')
    velocity_bandwidth: float = bounded(40.0, 1.0, 900.0, 'Hz', 'first-order filter')
    torque_noise: float = bounded(0.12, 0.0, 10.0, 'N·m', 'standard deviation')
    torque_bias: float = bounded(0.0, -10.0, 10.0, 'N·m', '')
    torque_gain_error: float = bounded(0.0, -0.2, 0.2, '', '')
    torque_bend: float = bounded(0.0, -0.2, 0.2, '', 'gain error at full torque')
    temperature_noise: float = bounded(0.1, 0.0, 10.0, 'K', 'standard deviation')
    ambient: float = bounded(25.0, -40.0, 60.0, '°C', 'air around the drives')
    initial_rise: float = bounded(8.0, 0.0, 100.0, 'K', 'drives above the air at the start')


@dataclass(frozen=True)
class Spread:
    """How much units of one design differ, as standard deviations of the logarithm."""

    electrical: float = bounded(0.03, 0.0, 0.3, '', 'resistance, torque constant, inertia')
    friction: float = bounded(0.12, 0.0, 0.5, '', 'every friction and iron loss')
    idle: float = bounded(0.03, 0.0, 0.3, '', 'idle draw')
    thermal: float = bounded(0.08, 0.0, 0.5, '', 'heat capacities and conductances')
    meter_gain: float = bounded(0.004, 0.0, 0.1, '', 'gain errors of the meter')
    meter_offset: float = bounded(0.01, 0.0, 1.0, 'A', 'current offsets of the meter')
    torque_bias: float = bounded(0.1, 0.0, 5.0, 'N·m', 'torque sensors')


_SPREAD_OF = {
    'electrical': ('resistance', 'torque_constant', 'rotor_inertia', 'line_resistance'),
    'friction': (
        *('coulomb', 'viscous', 'stribeck', 'load_friction', 'hysteresis', 'eddy', 'cogging'),
        *('rub', 'device_drop'),
    ),
    'idle': ('idle_power',),
    'thermal': (
        *('winding_capacity', 'winding_conductance', 'housing_capacity', 'housing_conductance'),
    ),
}


@dataclass(frozen=True)
class Plant:
    """
    A robot's drives with everything between supply and joint, meter and sensors.

    drive_types: parameters by type; the type of a drive is what follows the last underscore of
    its name, or `default`. unit: 0 for a unit exactly as written; any other number draws the
    spread of that unit's parts.
    """

    name: str = 'default'
    drive_types: Mapping[str, DriveParameters] = field(
        default_factory=lambda: {'default': DriveParameters()}
    )
    effects: Effects = field(default_factory=Effects)
    supply: SupplyParameters = field(default_factory=SupplyParameters)
    meter: MeterParameters = field(default_factory=MeterParameters)
    sensors: SensorParameters = field(default_factory=SensorParameters)
    spread: Spread = field(default_factory=Spread)
    unit_number: int = 0

    def __post_init__(self) -> None:
        for kind, parameters in self.drive_types.items():
            check(parameters, f'drive_types.{kind}')
        for group in ('supply', 'meter', 'sensors', 'spread'):
            check(getattr(self, group), group)
        if not isinstance(self.unit_number, int) or self.unit_number < 0:
            raise InputError(f'unit_number is {self.unit_number!r}; it must be an integer from 0')

    def unit(self, number: int) -> 'Plant':
        """Another unit of the same design."""
        return replace(self, unit_number=number)

    def with_effects(self, **changes: Effect | bool | float) -> 'Plant':
        """The same plant with some effects switched or scaled: `with_effects(fan=True)`."""
        current: dict[str, Any] = {name: asdict(effect) for name, effect in self.effects}
        current.update({k: asdict(v) if isinstance(v, Effect) else v for k, v in changes.items()})
        return replace(self, effects=Effects.parse(current))

    def parameters(self, drive: str) -> DriveParameters:
        """Those of the drive's type; InputError for a type that the plant does not have."""
        kind = drive.rsplit('_', 1)[-1]
        found = self.drive_types.get(kind, self.drive_types.get('default'))
        if found is None:
            raise InputError(
                f'plant {self.name!r} has no drive type for {drive!r}; '
                f'there are {", ".join(self.drive_types)}'
            )
        return found

    def resolve(self, drives: Sequence[str]) -> dict[str, Floats]:
        """
        Parameters of this unit's drives by name of the field, each [D].

        Adds the errors of this unit's sensors: `voltage_gain`, `current_gain`, `current_offset`
        (meter) and `torque_bias`. A drive draws the same parts whichever others are asked for.
        """
        rows = [self.parameters(drive) for drive in drives]
        values = {
            entry.name: np.array([float(getattr(row, entry.name)) for row in rows])
            for entry in fields(DriveParameters)
        }
        errors = [_Draw(self, drive) for drive in drives]
        for group, names in _SPREAD_OF.items():
            width = getattr(self.spread, group)
            for name in names:
                values[name] *= np.array([draw.factor(width) for draw in errors])
        spread = self.spread
        for name, centre, width in (
            ('voltage_gain', 1.0 + self.meter.voltage_gain_error, spread.meter_gain / 2),
            ('current_gain', 1.0 + self.meter.current_gain_error, spread.meter_gain),
            ('current_offset', self.meter.current_offset, spread.meter_offset),
            ('torque_bias', self.sensors.torque_bias, spread.torque_bias),
        ):
            values[name] = np.array([centre + draw.shift(width) for draw in errors])
        return values

    @classmethod
    def load(cls, source: Path | str) -> 'Plant':
        """Read a plant file, or a shipped plant by name; InputError says what is wrong in it."""
        return cls.parse(read_named(source, PLANTS, 'plant'))

    @classmethod
    def parse(cls, values: object) -> 'Plant':
        """From the mapping in a plant file."""
        if not isinstance(values, Mapping):
            raise InputError(f'a plant must be a mapping, not {values!r}')
        groups: dict[str, Any] = {
            'supply': SupplyParameters,
            'meter': MeterParameters,
            'sensors': SensorParameters,
            'spread': Spread,
        }
        known = ('name', 'unit_number', 'drive_types', 'effects', *groups)
        given: dict[str, Any] = {}
        for key, value in values.items():
            if key not in known:
                raise InputError(f'a plant has no {key!r}; there are {", ".join(known)}')
            if key in groups:
                given[key] = from_mapping(groups[key], value, key)
            elif key == 'effects':
                given[key] = Effects.parse(value)
            elif key == 'drive_types':
                given[key] = _parse_types(value)
            else:
                given[key] = value
        return cls(**given)

    def save(self, path: Path) -> None:
        """Write a file that `load` reads back as an equal plant; replaces an old one at once."""
        values = asdict(self)
        values['drive_types'] = {kind: asdict(p) for kind, p in self.drive_types.items()}
        values['effects'] = {name: asdict(effect) for name, effect in self.effects}
        part = path.with_name(path.name + '.part')
        part.write_text(yaml.safe_dump(values, sort_keys=False), encoding='utf-8')
        part.replace(path)


class _Draw:
    """The spread of one drive's parts, in a fixed order; nothing for unit 0."""

    def __init__(self, plant: Plant, drive: str) -> None:
        entropy = [plant.unit_number, *drive.encode()]
        self._random = np.random.default_rng(entropy) if plant.unit_number else None

    def factor(self, width: float) -> float:
        return float(np.exp(self.shift(width)))

    def shift(self, width: float) -> float:
        if self._random is None:
            return 0.0
        return width * float(np.clip(self._random.standard_normal(), -2.5, 2.5))


def _parse_types(values: object) -> dict[str, DriveParameters]:
    if not isinstance(values, Mapping) or not values:
        raise InputError(f'drive_types is {values!r}; it must map types to parameters')
    return {
        str(kind): from_mapping(DriveParameters, row or {}, f'drive_types.{kind}')
        for kind, row in values.items()
    }
