"""Parameters of a true plant: its drives, supply and instruments."""

from dataclasses import astuple, dataclass, fields

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Drive:
    """One drive, all at the joint (behind the gear); what is 0 does not exist."""

    torque_limit: float = 80.0  # N·m
    speed_limit: float = 7.5  # rad/s
    torque_constant: float = 5.4  # N·m/A at 25 °C, without load
    magnet_temperature: float = 0.0  # 1/K by which the torque constant falls
    saturation: float = 0.0  # more current for the same torque at the limit
    resistance: float = 0.5  # ohm at 25 °C
    copper_temperature: float = 0.0039  # 1/K
    inertia: float = 0.07  # kg·m²
    stiffness: float = 0.0  # N·m/rad, 0: rigid
    torque_loop: float = 50.0  # Hz, closed on the deflection
    loop_damping: float = 0.8
    loop_delay: float = 0.0005  # s
    current_loop: float = 600.0  # Hz
    torque_ripple: float = 0.0  # share of the torque
    ripple_order: float = 42.0  # periods per turn of the joint
    cogging: float = 0.0  # N·m
    cogging_order: float = 24.0
    phase: float = 0.0  # rad, of whatever repeats with the turn
    coulomb: float = 1.5  # N·m
    stribeck: float = 0.0  # N·m
    stribeck_speed: float = 0.4  # rad/s
    viscous: float = 2.4  # N·m at 1 rad/s
    speed_exponent: float = 1.0
    load_friction: float = 0.0  # share of the torque
    load_with_speed: float = 0.0  # how much of that share more at the speed limit
    grease: float = 0.0  # 1/K by which speed's part of friction falls
    presliding_speed: float = 0.03  # rad/s
    eccentric_drag: float = 0.0  # share of the dry friction, once per turn
    rub: float = 0.0  # N·m around one angle
    rub_angle: float = 0.5  # rad
    rub_width: float = 0.15  # rad
    iron: float = 0.25  # W at 1 rad/s
    iron_exponent: float = 1.5
    device_drop: float = 0.0  # V
    device_resistance: float = 0.0  # ohm
    switching: float = 0.0  # time × frequency
    dead_time: float = 0.0  # time × frequency
    current_gain: float = 2.0  # V/A of the current loop
    pole_pairs: float = 350.0  # times the gear
    idle: float = 8.2  # W at the nominal voltage
    fan: float = 0.0  # W while it runs
    fan_period: float = 9.0  # s
    line: float = 0.0  # ohm, meter to drive
    returned: float = 1.0  # share of braking power that comes back to the link
    weakening: float = 0.0  # A per V that the voltage lacks
    winding_capacity: float = 60.0  # J/K
    winding_conductance: float = 0.7  # W/K
    housing_capacity: float = 850.0  # J/K
    housing_conductance: float = 0.85  # W/K
    air: float = 25.0  # °C
    start: float = 30.0  # °C of the drive
    torque_at_motor: float = 0.0  # 1: torque is computed from the current
    torque_scale: float = 1.0
    torque_bias: float = 0.0  # N·m
    torque_hysteresis: float = 0.0  # N·m, half width
    torque_filter: float = 150.0  # Hz
    encoder_error: float = 0.0  # rad
    encoder_order: float = 1.0
    velocity_filter: float = 60.0  # Hz
    meter_gain: float = 1.0
    meter_offset: float = 0.0  # A
    meter_filter: float = 300.0  # Hz
    cross_talk: float = 0.0  # share of the neighbour's current


@dataclass(frozen=True)
class Supply:
    """Source, bus and whatever else draws from it."""

    voltage: float = 48.0  # V, nominal
    resistance: float = 0.01  # ohm, of source and its cable
    discharge: float = 0.0  # V by which the source falls in 10 minutes
    capacitance: float = 0.01  # F
    blocked: bool = False  # nothing flows back into the source
    chopper_rise: float = 4.0  # V above the source at which brake resistors take the rest
    electronics: float = 60.0  # W
    electronics_spread: float = 5.0  # W


@dataclass(frozen=True)
class Sampling:
    """Moments and noise of the readings."""

    joint_rate: float = 400.0  # Hz
    meter_rate: float = 1000.0  # Hz
    jitter: float = 0.0  # share of the period, of the reading against the even clock
    skew: float = 0.0  # s, most by which a drive is read later than its message says
    meter_delay: float = 0.0  # s, reading of the meter against its stamp
    position_noise: float = 2e-4  # rad
    velocity_noise: float = 1e-3  # of the speed limit
    torque_noise: float = 1.5e-3  # of the torque limit
    current_noise: float = 0.02  # A
    voltage_noise: float = 0.01  # V
    temperature: bool = True  # whether the winding's temperature is measured


DRIVE = np.dtype([(entry.name, np.float64) for entry in fields(Drive)])


def table(drives: tuple[Drive, ...]) -> NDArray[np.void]:
    """Return the parameters of D drives as records [D]."""
    return np.array([astuple(drive) for drive in drives], dtype=DRIVE)
