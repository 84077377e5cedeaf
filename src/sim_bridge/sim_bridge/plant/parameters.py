"""Parameters of the simulated hardware: supply, drives, effects, meter and joint sensors.

A plant is read from a YAML file; the sources of the figures are in
`docs/explanation/simulated_hardware.md`.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, field, fields, replace
from pathlib import Path
from typing import Annotated

import numpy as np
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError
from wattwalk_core.files import write_whole
from wattwalk_core.schema import Quantity, check, parse, schema
from wattwalk_core.yaml_file import dump_yaml, read_yaml, shipped_file

from sim_bridge.plant.wear import apply_wear, check_wear


@schema
class SimulatedEffect:
    """One effect; its strength multiplies the parameter that drives it (1: as in the file)."""

    enabled: bool = True
    strength: Annotated[float, Quantity(0.0, 10.0, '', 'multiplier of the effect')] = 1.0

    @property
    def scale(self) -> float:
        """Strength, or 0 when switched off."""
        return self.strength if self.enabled else 0.0


_ON = SimulatedEffect()
_OFF = SimulatedEffect(enabled=False)


@schema
class Effects:
    """Effects by the names of power_estimator's catalogue, plus three unmodelled effects.

    Unmodelled: `position_rub` (friction at certain angles), `fan` (power drawn over time, whatever
    the joint does) and `cross_talk` (a neighbour's current in a drive's reading). Of real drives
    and off unless a plant has them on: `torque_loop` (closed on the spring's deflection),
    `torque_ripple`, `dead_time` (of the inverter), `magnet_heating` (the torque constant falls),
    `battery` (a source with internal resistance), and of the instruments `encoder_eccentricity`,
    `torque_hysteresis` and `meter_filter` (a slow meter).
    """

    copper_loss: SimulatedEffect = _ON
    winding_heating: SimulatedEffect = _ON
    coulomb_friction: SimulatedEffect = _ON
    viscous_friction: SimulatedEffect = _ON
    stribeck_friction: SimulatedEffect = _ON
    load_friction: SimulatedEffect = _ON
    rotor_inertia: SimulatedEffect = _ON
    iron_loss: SimulatedEffect = _ON
    inverter_loss: SimulatedEffect = _ON
    idle: SimulatedEffect = _ON
    line_resistance: SimulatedEffect = _ON
    regeneration_efficiency: SimulatedEffect = _ON
    regeneration_limit: SimulatedEffect = _ON
    field_weakening: SimulatedEffect = _ON
    cogging: SimulatedEffect = _ON
    spring: SimulatedEffect = _OFF
    position_rub: SimulatedEffect = _OFF
    fan: SimulatedEffect = _OFF
    cross_talk: SimulatedEffect = _OFF
    torque_loop: SimulatedEffect = _OFF
    torque_ripple: SimulatedEffect = _OFF
    dead_time: SimulatedEffect = _OFF
    magnet_heating: SimulatedEffect = _OFF
    battery: SimulatedEffect = _OFF
    encoder_eccentricity: SimulatedEffect = _OFF
    torque_hysteresis: SimulatedEffect = _OFF
    meter_filter: SimulatedEffect = _OFF

    def __post_init__(self) -> None:
        if self.spring.enabled and not self.rotor_inertia.scale:
            raise InputError('effects: spring is on without rotor_inertia; switch both on')
        if self.torque_loop.enabled and not self.spring.enabled:
            raise InputError(
                'effects: torque_loop is on without spring, whose deflection it reads'
            )

    def __iter__(self) -> Iterator[tuple[str, SimulatedEffect]]:
        for entry in fields(self):
            yield entry.name, getattr(self, entry.name)

    @classmethod
    def parse(cls, values: object) -> 'Effects':
        """Build from names mapped to true, false, a strength, or {enabled, strength}.

        Absent names keep their default. InputError for an unknown name or a bad value.
        """
        return parse(cls, expand(values), 'effects')


def expand(values: object) -> object:
    """Return effects with short forms (true, false, a strength) as {enabled, strength}."""
    if not isinstance(values, Mapping):
        return values
    expanded = dict(values)
    for name, value in values.items():
        if isinstance(value, bool):
            expanded[name] = {'enabled': value}
        elif isinstance(value, int | float):
            expanded[name] = {'enabled': value != 0, 'strength': value or 1.0}
    return expanded


PLANTS = Path(__file__).parents[1] / 'plants'


@schema
class DriveParameters:
    """Parameters of one type of drive, all at the joint (behind the gear)."""

    resistance: Annotated[float, Quantity(0.01, 10.0, 'ohm', 'DC equivalent, at 25 °C')] = 0.5
    torque_constant: Annotated[float, Quantity(0.1, 20.0, 'N·m/A', 'motor and gear')] = 5.4
    saturation: Annotated[float, Quantity(0.0, 0.5, '', 'more current at full torque')] = 0.05
    reactance: Annotated[float, Quantity(0.001, 1.0, 'V·s/(rad·A)', 'at speed')] = 0.08
    torque_limit: Annotated[float, Quantity(1.0, 500.0, 'N·m')] = 80.0
    modulation: Annotated[float, Quantity(0.5, 1.0, '', 'of the bus voltage')] = 0.95
    weakening_current: Annotated[float, Quantity(0.0, 50.0, 'A', 'of field weakening')] = 10.0
    temperature_coefficient: Annotated[float, Quantity(0.0, 0.01, '1/K', 'resistance')] = 0.0039
    winding_capacity: Annotated[float, Quantity(1.0, 1e4, 'J/K')] = 60.0
    winding_conductance: Annotated[float, Quantity(0.01, 100.0, 'W/K', 'winding to housing')] = 0.7
    housing_capacity: Annotated[float, Quantity(1.0, 1e5, 'J/K')] = 850.0
    housing_conductance: Annotated[float, Quantity(0.01, 100.0, 'W/K', 'housing to air')] = 0.85
    coulomb: Annotated[float, Quantity(0.0, 20.0, 'N·m')] = 1.5
    presliding_velocity: Annotated[float, Quantity(0.005, 1.0, 'rad/s', 'of dry friction')] = 0.05
    viscous: Annotated[float, Quantity(0.0, 20.0, 'N·m·s/rad', 'at standstill')] = 2.4
    shear_velocity: Annotated[float, Quantity(1.0, 1e3, 'rad/s', 'viscosity halved')] = 40.0
    stribeck: Annotated[float, Quantity(0.0, 20.0, 'N·m', 'beside Coulomb')] = 0.8
    stribeck_velocity: Annotated[float, Quantity(0.02, 10.0, 'rad/s')] = 0.5
    load_friction: Annotated[float, Quantity(0.0, 0.5, '', 'share of the torque')] = 0.06
    load_asymmetry: Annotated[float, Quantity(-0.9, 0.9, '', 'driving against driven')] = 0.1
    rotor_inertia: Annotated[float, Quantity(0.0, 1.0, 'kg·m²', 'rotor and gear')] = 0.0675
    output_viscous: Annotated[float, Quantity(0.0, 20.0, 'N·m·s/rad', 'behind the spring')] = 0.0
    output_inertia: Annotated[float, Quantity(0.0, 1.0, 'kg·m²', 'behind the spring')] = 0.0
    hysteresis: Annotated[float, Quantity(0.0, 10.0, 'W', 'iron loss at 1 rad/s')] = 0.22
    hysteresis_exponent: Annotated[float, Quantity(1.0, 2.0)] = 1.15
    eddy: Annotated[float, Quantity(0.0, 10.0, 'W', 'iron loss at 1 rad/s')] = 0.05
    eddy_exponent: Annotated[float, Quantity(1.0, 2.5)] = 1.85
    device_drop: Annotated[float, Quantity(0.0, 5.0, 'V', 'of the switches')] = 0.25
    device_resistance: Annotated[float, Quantity(0.0, 1.0, 'ohm', 'of the switches')] = 0.02
    switching_share: Annotated[float, Quantity(0.0, 0.1, '', 'time × frequency')] = 0.004
    idle_power: Annotated[float, Quantity(0.0, 100.0, 'W', 'at the nominal voltage')] = 8.2
    line_resistance: Annotated[float, Quantity(0.0, 2.0, 'ohm', 'meter to drive')] = 0.1
    regeneration_efficiency: Annotated[float, Quantity(0.0, 1.0)] = 0.88
    cogging: Annotated[float, Quantity(0.0, 20.0, 'N·m')] = 0.25
    cogging_order: Annotated[float, Quantity(1.0, 1e4, '', 'periods per turn')] = 300.0
    spring_stiffness: Annotated[float, Quantity(50.0, 1e4, 'N·m/rad', 'gear to joint')] = 400.0
    spring_damping: Annotated[float, Quantity(0.0, 20.0, 'N·m·s/rad', 'beside the spring')] = 2.5
    loop_bandwidth: Annotated[float, Quantity(5.0, 120.0, 'Hz', 'of the torque loop')] = 50.0
    loop_damping: Annotated[float, Quantity(0.1, 3.0, '', 'of critical')] = 0.8
    loop_delay: Annotated[float, Quantity(0.0, 0.004, 's', 'of the torque loop')] = 0.0005
    current_bandwidth: Annotated[float, Quantity(50.0, 5e3, 'Hz', 'of the current loop')] = 800.0
    torque_ripple: Annotated[float, Quantity(0.0, 0.2, '', 'share of the torque')] = 0.015
    ripple_order: Annotated[float, Quantity(1.0, 1e5, '', 'periods per turn')] = 2100.0
    dead_time: Annotated[float, Quantity(0.0, 0.1, '', 'time × frequency')] = 0.02
    dead_torque: Annotated[float, Quantity(0.0, 20.0, 'N·m', 'lost around no current')] = 0.6
    magnet_coefficient: Annotated[float, Quantity(0.0, 0.01, '1/K', 'torque constant')] = 0.001
    rub: Annotated[float, Quantity(0.0, 20.0, 'N·m', 'at its worst angle')] = 4.0
    rub_angle: Annotated[float, Quantity(-10.0, 10.0, 'rad', 'of the worst angle')] = 0.9
    rub_width: Annotated[float, Quantity(0.01, 3.0, 'rad')] = 0.15
    fan: Annotated[float, Quantity(0.0, 100.0, 'W', 'while it runs')] = 6.0
    fan_period: Annotated[float, Quantity(0.5, 1e4, 's')] = 9.0


@schema
class SupplyParameters:
    """Parameters of bench supply, bus capacitor, brake choppers and the robot's electronics."""

    voltage: Annotated[float, Quantity(5.0, 800.0, 'V', 'of the supply without load')] = 48.0
    resistance: Annotated[float, Quantity(0.0, 5.0, 'ohm', 'supply to power board')] = 0.05
    battery_resistance: Annotated[float, Quantity(0.0, 5.0, 'ohm', 'of the battery')] = 0.1
    capacitance: Annotated[float, Quantity(1e-4, 1.0, 'F', 'of the bus')] = 0.012
    chopper_rise: Annotated[float, Quantity(0.5, 100.0, 'V', 'chopper above supply')] = 4.0
    electronics: Annotated[float, Quantity(0.0, 2e3, 'W', 'computers and sensors, mean')] = 192.0
    electronics_variation: Annotated[float, Quantity(0.0, 500.0, 'W', 'standard deviation')] = 5.0
    electronics_time: Annotated[float, Quantity(0.05, 1e4, 's', 'how slowly they vary')] = 6.0
    voltage_noise: Annotated[float, Quantity(0.0, 5.0, 'V', 'of the supply reading')] = 0.01
    current_noise: Annotated[float, Quantity(0.0, 5.0, 'A', 'of the supply reading')] = 0.02
    brake_in_drives: bool = True


@schema
class MeterParameters:
    """Parameters of the power meter: a voltage and a current channel per drive at 1 kHz."""

    voltage_noise: Annotated[float, Quantity(0.0, 5.0, 'V', 'standard deviation')] = 0.01
    current_noise: Annotated[float, Quantity(0.0, 5.0, 'A', 'standard deviation')] = 0.025
    voltage_range: Annotated[float, Quantity(1.0, 1e3, 'V', 'full scale, from 0')] = 65.0
    current_range: Annotated[float, Quantity(0.1, 1e3, 'A', 'full scale, both signs')] = 30.0
    bits: Annotated[int, Quantity(6, 24, 'bit', 'of the converter')] = 16
    voltage_gain_error: Annotated[float, Quantity(-0.2, 0.2)] = 0.0
    current_gain_error: Annotated[float, Quantity(-0.2, 0.2)] = 0.0
    current_offset: Annotated[float, Quantity(-5.0, 5.0, 'A')] = 0.0
    delay: Annotated[float, Quantity(0.25e-3, 20e-3, 's', 'beside the filter')] = 0.4e-3
    bandwidth: Annotated[float, Quantity(5.0, 900.0, 'Hz', 'first-order filter')] = 450.0
    slow_bandwidth: Annotated[float, Quantity(1.0, 900.0, 'Hz', 'of a slow meter')] = 20.0
    cross_talk: Annotated[float, Quantity(-0.5, 0.5, '', 'of the neighbour')] = 0.05
    clock_offset: Annotated[float, Quantity(0.0, 1e5, 's', 'at the start')] = 0.0
    clock_drift: Annotated[float, Quantity(-500.0, 500.0, 'ppm', 'of the device clock')] = 18.0


@schema
class SensorParameters:
    """Parameters of the joint sensors: noise, filters and errors."""

    position_noise: Annotated[float, Quantity(0.0, 0.1, 'rad', 'standard deviation')] = 2e-4
    velocity_noise: Annotated[float, Quantity(0.0, 1.0, 'rad/s', 'standard deviation')] = 0.01
    velocity_bandwidth: Annotated[float, Quantity(1.0, 900.0, 'Hz', 'first-order filter')] = 40.0
    torque_noise: Annotated[float, Quantity(0.0, 10.0, 'N·m', 'standard deviation')] = 0.12
    torque_bias: Annotated[float, Quantity(-10.0, 10.0, 'N·m')] = 0.0
    torque_gain_error: Annotated[float, Quantity(-0.2, 0.2)] = 0.0
    torque_bend: Annotated[float, Quantity(-0.2, 0.2, '', 'gain error at full torque')] = 0.0
    torque_hysteresis: Annotated[float, Quantity(0.0, 10.0, 'N·m', 'half width')] = 0.5
    eccentricity: Annotated[float, Quantity(0.0, 0.1, 'rad', 'of the encoder')] = 2e-3
    temperature_noise: Annotated[float, Quantity(0.0, 10.0, 'K', 'standard deviation')] = 0.1
    ambient: Annotated[float, Quantity(-40.0, 60.0, '°C', 'air around the drives')] = 25.0
    initial_rise: Annotated[float, Quantity(0.0, 100.0, 'K', 'drives, at the start')] = 8.0


@schema
class Spread:
    """Differences between units of one design, as standard deviations of the logarithm."""

    electrical: Annotated[float, Quantity(0.0, 0.3, '', 'motor and cables')] = 0.03
    friction: Annotated[float, Quantity(0.0, 0.5, '', 'every friction and iron loss')] = 0.12
    idle: Annotated[float, Quantity(0.0, 0.3, '', 'idle draw')] = 0.03
    thermal: Annotated[float, Quantity(0.0, 0.5, '', 'heat capacities and conductances')] = 0.08
    meter_gain: Annotated[float, Quantity(0.0, 0.1, '', 'gain errors of the meter')] = 0.004
    meter_offset: Annotated[float, Quantity(0.0, 1.0, 'A', 'current offsets of the meter')] = 0.01
    torque_bias: Annotated[float, Quantity(0.0, 5.0, 'N·m', 'torque sensors')] = 0.1


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


@schema
class Plant:
    """Simulated hardware of a robot: drives, supply, meter and sensors.

    drive_types: parameters by type; the type of a drive is what follows the last underscore of
    its name, or `default`. unit_number: 0 for a unit exactly as written; others draw the
    spread of that unit's parts. wear: factors on single drives' parameters by the effect's name,
    and the `current_offset` of a sensor, A, as {LF_KFE: {coulomb_friction: 1.4}}.
    """

    name: str = 'default'
    drive_types: dict[str, DriveParameters] = field(
        default_factory=lambda: {'default': DriveParameters()}
    )
    effects: Effects = field(default_factory=Effects)
    supply: SupplyParameters = field(default_factory=SupplyParameters)
    meter: MeterParameters = field(default_factory=MeterParameters)
    sensors: SensorParameters = field(default_factory=SensorParameters)
    spread: Spread = field(default_factory=Spread)
    command_delay: Annotated[float, Quantity(0.0, 0.05, 's', 'a command on its way')] = 0.0
    unit_number: Annotated[int, Quantity(0, 2**31 - 1)] = 0
    wear: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_wear(self.wear)
        if not self.drive_types:
            raise InputError('drive_types is empty; describe at least one type')

    def unit(self, number: int) -> 'Plant':
        """Return unit `number` of the same design, 0 without spread; InputError below 0."""
        plant = replace(self, unit_number=number)
        check(plant, f'plant {self.name}')
        return plant

    def with_effects(self, **changes: SimulatedEffect | bool | float) -> 'Plant':
        """Return the plant with effects switched or scaled, as `with_effects(fan=True)`."""
        given = {
            name: asdict(value) if isinstance(value, SimulatedEffect) else value
            for name, value in changes.items()
        }
        return replace(self, effects=Effects.parse({**asdict(self.effects), **given}))

    def parameters(self, drive: str) -> DriveParameters:
        """Return the parameters of the drive's type; InputError for an unknown type."""
        kind = drive.rsplit('_', 1)[-1]
        found = self.drive_types.get(kind, self.drive_types.get('default'))
        if found is None:
            raise InputError(
                f'plant {self.name!r} has no drive type for {drive!r}; '
                f'there are {", ".join(self.drive_types)}'
            )
        return found

    def resolve(self, drives: Sequence[str]) -> dict[str, Floats]:
        """Return the parameters of this unit's drives by name of the field, each [D].

        Adds the errors of this unit's sensors: `voltage_gain`, `current_gain`, `current_offset`
        (meter) and `torque_bias`. Values of a drive do not depend on the others in `drives`.
        """
        rows = [self.parameters(drive) for drive in drives]
        values = {
            entry.name: np.array([float(getattr(row, entry.name)) for row in rows])
            for entry in fields(DriveParameters)
        }
        errors = [_spread(self.unit_number, drive) for drive in drives]
        for group, names in _SPREAD_OF.items():
            width = getattr(self.spread, group)
            for name in names:
                values[name] *= np.array([np.exp(width * next(error)) for error in errors])
        spread = self.spread
        for name, centre, width in (
            ('voltage_gain', 1.0 + self.meter.voltage_gain_error, spread.meter_gain / 2),
            ('current_gain', 1.0 + self.meter.current_gain_error, spread.meter_gain),
            ('current_offset', self.meter.current_offset, spread.meter_offset),
            ('torque_bias', self.sensors.torque_bias, spread.torque_bias),
        ):
            values[name] = np.array([centre + width * next(error) for error in errors])
        apply_wear(values, drives, self.wear)
        return values

    @classmethod
    def load(cls, source: Path | str, unit: int | None = None) -> 'Plant':
        """Read a plant file, or a shipped plant by name; InputError says what is wrong in it.

        unit: which unit of it, that of the file if None.
        """
        path = shipped_file(source, PLANTS, 'plant')
        plant = cls.parse(read_yaml(path, 'plant'), f'plant {path}')
        return plant if unit is None else plant.unit(unit)

    @classmethod
    def parse(cls, values: object, where: str = 'plant') -> 'Plant':
        """Build from the content of a plant file; errors begin with `where`."""
        if isinstance(values, Mapping) and 'effects' in values:
            values = {**values, 'effects': expand(values['effects'])}
        return parse(cls, values, where)

    def save(self, path: Path) -> None:
        """Write a file that `load` reads back as an equal plant, in place of an old one."""
        write_whole(path, dump_yaml(asdict(self)))


def _spread(unit: int, drive: str) -> Iterator[float]:
    """Yield the random errors of a drive's parameters, in a fixed order; zeros for unit 0."""
    random = np.random.default_rng([unit, *drive.encode()])
    while True:
        yield float(np.clip(random.standard_normal(), -2.5, 2.5)) if unit else 0.0
