"""Steps of the true plant, compiled: mechanics, currents, voltages and instruments of D drives.

Nothing here knows the lab's formulas: power is voltage times current at the meter, and the parts
are counted beside it so that they sum to it.
"""

from math import cos, exp, pi, sin, sqrt, tanh
from typing import Final

import numpy as np
from numba import njit

STEP: Final = 0.00025  # s
KNOT: Final = 20  # steps between knots of a motion: 200 Hz
PART: Final = 80  # steps over which parts are averaged: 50 Hz
RING: Final = 32  # steps of delay at most
PARTS: Final = (
    *('shaft', 'spring', 'rotor_inertia', 'cogging', 'coulomb_friction', 'stribeck_friction'),
    *('viscous_friction', 'load_friction', 'unmodelled_friction', 'copper_loss'),
    *('winding_heating', 'saturation', 'iron_loss', 'inverter_loss', 'field_weakening'),
    *('regeneration_efficiency', 'idle', 'fan', 'line_resistance', 'regeneration_limit'),
)
"""Order of the parts, which sum to the power at the meter but for what rounding leaves."""
STATE: Final = np.dtype(
    [
        (name, np.float64)
        for name in (
            *('angle', 'speed', 'air', 'dead', 'slip', 'load', 'torque', 'velocity', 'volts'),
            *('amps', 'winding', 'housing', 'drawn', 'back', 'burned', 'friction'),
            *('effective', 'squared', 'warmth'),
        )
    ]
)
"""State of a drive: mechanics, filters, temperatures, bus, and sums for its true coefficients."""


@njit(cache=True, error_model='numpy', inline='always')
def _spline(knots, first, u, d):  # type: ignore[no-untyped-def]
    """Value, rate per knot and second rate of a uniform cubic B-spline."""
    a, b, c, e = knots[first, d], knots[first + 1, d], knots[first + 2, d], knots[first + 3, d]
    v = 1.0 - u
    value = v * v * v * a + (3.0 * u * u * u - 6.0 * u * u + 4.0) * b
    value = value + (-3.0 * u * u * u + 3.0 * u * u + 3.0 * u + 1.0) * c + u * u * u * e
    rate = -v * v * a + (3.0 * u * u - 4.0 * u) * b + (-3.0 * u * u + 2.0 * u + 1.0) * c
    rate = 0.5 * (rate + u * u * e)
    return value / 6.0, rate, v * a + (3.0 * u - 2.0) * b + (1.0 - 3.0 * u) * c + u * e


@njit(cache=True, error_model='numpy')
def _drag(p, angle, speed, load, housing):  # type: ignore[no-untyped-def]
    """Coulomb, Stribeck, speed's, load's and unmodelled parts of friction before the sign."""
    fast = abs(speed)
    thin = exp(-p.grease * (housing - 25.0))
    fading = fast / p.stribeck_speed
    away = (angle - p.rub_angle) / p.rub_width
    away -= 2.0 * pi / p.rub_width * round(away * p.rub_width / (2.0 * pi))
    other = p.coulomb * p.eccentric_drag * cos(angle + p.phase) + p.rub * exp(-away * away)
    viscous = 0.0
    if p.viscous != 0.0:
        viscous = p.viscous * fast**p.speed_exponent * thin
    share = p.load_friction * (1.0 + p.load_with_speed * fast / p.speed_limit) * sqrt(thin)
    return p.coulomb, p.stribeck / (1.0 + fading * fading), viscous, share * abs(load), other


@njit(cache=True, error_model='numpy')
def _inverse_saturation(p, linear):  # type: ignore[no-untyped-def]
    """Torque of a current that would make a linear torque without saturation."""
    torque = linear
    for _ in range(4):
        share = torque / p.torque_limit
        bent = 1.0 + p.saturation * share * share
        slope = 1.0 + 3.0 * p.saturation * share * share
        torque -= (torque * bent - linear) / slope
    return torque


@njit(cache=True, error_model='numpy')
def _link(p, s, torque, speed, voltage, nominal, time, fan_phase, parts, lost):  # type: ignore[no-untyped-def]
    """Power at the drive's DC link, W; adds the electrical parts and sets heat and current."""
    warm = s.winding - 25.0
    constant = p.torque_constant * (1.0 - p.magnet_temperature * warm)
    share = torque / p.torque_limit
    working = torque * (1.0 + p.saturation * share * share) / constant
    fast = abs(speed)
    iron = 0.0
    if p.iron != 0.0 and fast > 0.0:
        iron = p.iron * fast**p.iron_exponent
    through = working + iron * speed / (constant * (fast * fast + 1e-9))
    available = 0.95 * voltage
    lacking = max(constant * fast + p.resistance * abs(through) - 0.8 * available, 0.0)
    field = p.weakening * lacking
    resistance = p.resistance * (1.0 + p.copper_temperature * warm)
    size = sqrt(through * through + field * field)
    drop = p.device_drop * tanh(size / 0.3) + p.device_resistance * size
    diode = p.dead_time * 2.0 * (0.9 - 0.5 * p.device_drop) * tanh(size / 0.3)
    inverter = size * (drop + p.switching * voltage + diode)
    copper = resistance * through * through
    weak = resistance * field * field
    induced = torque * speed + iron * fast * fast / (fast * fast + 1e-9)
    bridge = induced + copper + weak + inverter
    back = (1.0 - p.returned) * max(-bridge, 0.0)
    idle = p.idle * (0.7 + 0.3 * voltage / nominal)
    fan = 0.0
    if p.fan != 0.0:
        turn = (time / p.fan_period + fan_phase) % 1.0
        fan = p.fan / (1.0 + exp(-60.0 * (turn - 0.5)))
    plain = torque / p.torque_constant
    cold = p.resistance * plain * plain
    parts[9] += cold
    parts[10] += (resistance - p.resistance) * plain * plain
    parts[11] += copper - resistance * plain * plain
    parts[12] += induced - torque * speed
    parts[13] += inverter
    parts[14] += weak
    parts[15] += back
    parts[16] += idle
    parts[17] += fan
    s.effective += (resistance + p.device_resistance) * working * working
    known = working * p.torque_constant if p.torque_at_motor != 0.0 else torque
    s.squared += known * known
    heat = copper + weak
    flow = p.winding_conductance * (s.winding - s.housing)
    s.winding += STEP * (heat - flow) / p.winding_capacity
    out = p.housing_conductance * (s.housing - p.air)
    s.warmth += s.housing
    s.housing += STEP * (flow + lost + 0.5 * (iron + inverter) + idle - out) / p.housing_capacity
    return bridge + back + idle + fan, through


@njit(cache=True, error_model='numpy')
def _sense(p, s, angle, speed, torque, current, volts, amps, keep):  # type: ignore[no-untyped-def]
    """Advance the instruments' filters; keep: decays of torque, velocity and meter."""
    reach = 4.0 * p.torque_hysteresis + 1e-12
    s.slip = max(min(s.slip + (torque - s.load) / reach, 1.0), -1.0)
    s.load = torque
    if p.torque_at_motor != 0.0:
        torque = current * p.torque_constant
    shown = torque * p.torque_scale + p.torque_hysteresis * s.slip + p.torque_bias
    s.torque = shown + (s.torque - shown) * keep[0]
    wobble = p.encoder_error * p.encoder_order * cos(p.encoder_order * angle + p.phase)
    shown = speed * (1.0 + wobble)
    s.velocity = shown + (s.velocity - shown) * keep[1]
    s.volts = volts + (s.volts - volts) * keep[2]
    s.amps = amps + (s.amps - amps) * keep[2]


@njit(cache=True, error_model='numpy')
def run(
    drives,
    state,
    position,
    torque,
    source,
    other,
    supply,
    joint_at,
    meter_at,
    joints,
    meter,
    parts,
    power,
):  # type: ignore[no-untyped-def]
    """Run the plant through a motion of K knots; write samples, parts and power.

    drives, state: records [D]. position (rad), torque (N·m): knots [K, D]; source (V), other (W
    drawn by other consumers, before the diode that blocks): at the knots [K]. supply: nominal
    voltage, resistance, capacitance, blocked, chopper's rise. joint_at, meter_at: steps to sample
    [D, N], ascending. joints: position, velocity, torque, winding [4, D, N]; meter: voltage,
    current [2, D, M]; parts: [P, D, len(PARTS)]; power: at the meter [P, D].
    """
    count = len(drives)
    knots = len(position) - 3
    nominal, resistance, capacitance = supply[0], supply[1], supply[2]
    blocked, rise = supply[3] != 0.0, supply[4]
    ring = np.zeros((count, RING))
    keep = np.zeros((count, 3))
    control = np.zeros((count, 4))
    here = np.zeros((2, count), np.int64)
    added = np.zeros(len(PARTS))
    conductance = 1.0 / resistance
    volts, burn = source[0], 0.0
    for d in range(count):
        p, s = drives[d], state[d]
        q, w, _ = _spline(position, 0, 0.0, d)
        want, _, _ = _spline(torque, 0, 0.0, d)
        s.angle, s.speed, s.air, s.load, s.torque = q, w / (KNOT * STEP), want, want, want
        s.velocity, s.volts, s.amps = s.speed, volts, p.idle / volts
        s.winding, s.housing = p.start + 2.0, p.start
        keep[d, 0] = exp(-2.0 * pi * p.torque_filter * STEP)
        keep[d, 1] = exp(-2.0 * pi * p.velocity_filter * STEP)
        keep[d, 2] = exp(-2.0 * pi * p.meter_filter * STEP)
        control[d, 0] = 1.0 - exp(-2.0 * pi * p.current_loop * STEP)
        if p.stiffness > 0.0:
            s.angle += want / p.stiffness
            natural = 2.0 * pi * p.torque_loop
            control[d, 1] = max(natural * natural * p.inertia / p.stiffness - 1.0, 0.0)
            natural = sqrt((1.0 + control[d, 1]) * p.stiffness / p.inertia)
            control[d, 2] = 2.0 * p.loop_damping * natural * p.inertia
        ring[d, :] = want
    for n in range(knots * KNOT):
        knot = n // KNOT
        u = (n - knot * KNOT) / KNOT
        total, returned = 0.0, 0.0
        place = n // PART
        for d in range(count):
            p, s = drives[d], state[d]
            q, w, a = _spline(position, knot, u, d)
            want, _, _ = _spline(torque, knot, u, d)
            w, a = w / (KNOT * STEP), a / (KNOT * STEP * KNOT * STEP)
            elastic = p.stiffness > 0.0
            speed = s.speed if elastic else w
            angle = s.angle if elastic else q
            twist = 0.0
            if elastic:
                twist = p.stiffness * (angle - q)
                asked = want + control[d, 1] * (want - twist) - control[d, 2] * (speed - w)
            else:
                asked = want + p.inertia * a + s.friction
            ring[d, n % RING] = max(min(asked, 1.3 * p.torque_limit), -1.3 * p.torque_limit)
            late = ring[d, (n - int(p.loop_delay / STEP)) % RING]
            s.air += (late - s.air) * control[d, 0]
            air = s.air
            if p.dead_time != 0.0:
                error = volts * p.dead_time * tanh(air / (0.02 * p.torque_limit))
                error *= 1.0 + 0.2 * cos(6.0 * p.pole_pairs * angle)
                s.dead += (error - s.dead) * 0.05
                air -= p.torque_constant * (error - s.dead) / p.current_gain
            if elastic and p.saturation > 0.0:
                air = _inverse_saturation(p, air)
            if p.torque_ripple != 0.0:
                air *= 1.0 + p.torque_ripple * sin(p.ripple_order * angle + p.phase)
            cogging = p.cogging * sin(p.cogging_order * angle + p.phase)
            dry, fading, viscous, loaded, rest = _drag(p, angle, speed, s.load, s.housing)
            drag = dry + fading + viscous + loaded + rest
            if elastic:
                small = abs(speed) < 1e-6
                slope = 1.0 / p.presliding_speed
                if not small:
                    slope = tanh(speed / p.presliding_speed) / speed
                pull = STEP / p.inertia
                later = (speed + pull * (air - cogging - twist)) / (1.0 + pull * drag * slope)
                sign = slope * later
                rotor, rotor_rate = 0.5 * (speed + later), (later - speed) / STEP
                s.angle += later * STEP
                s.speed = later
            else:
                sign = tanh(speed / p.presliding_speed)
                rotor, rotor_rate = w, a
                twist = air - cogging - drag * sign - p.inertia * a
            s.friction = drag * sign
            added[:] = 0.0
            added[0] = twist * w
            added[1] = twist * (rotor - w)
            added[2] = p.inertia * rotor_rate * rotor
            added[3] = cogging * rotor
            for index, share in ((4, dry), (5, fading), (6, viscous), (7, loaded), (8, rest)):
                added[index] = share * sign * rotor
            link, current = _link(
                p, s, air, rotor, volts, nominal, n * STEP, 0.37 * d, added, s.friction * rotor
            )
            s.back = max(-link, 0.0)
            link += s.burned
            added[19] = s.burned
            amps = 2.0 * link / (volts + sqrt(max(volts * volts - 4.0 * p.line * link, 1.0)))
            added[18] = p.line * amps * amps
            s.drawn = volts * amps
            total += s.drawn
            returned += s.back
            _sense(p, s, q, w, twist, current, volts, amps, keep[d])
            if place < len(parts):
                for index in range(len(PARTS)):
                    parts[place, d, index] += added[index] / PART
                power[place, d] += s.drawn / PART
            k = here[0, d]
            if k < joint_at.shape[1] and n == joint_at[d, k]:
                error = p.encoder_error * sin(p.encoder_order * q + p.phase)
                joints[0, d, k], joints[1, d, k] = q + error, s.velocity
                joints[2, d, k], joints[3, d, k] = s.torque, s.winding
                here[0, d] += 1
            k = here[1, d]
            if k < meter_at.shape[1] and n == meter_at[d, k]:
                meter[0, d, k], meter[1, d, k] = s.volts, s.amps
                here[1, d] += 1
        feed = conductance
        if blocked and volts > source[knot]:
            feed = 0.0
        drawn = (total if blocked else total + other[knot]) / volts
        before = volts
        volts = (before + STEP / capacitance * (source[knot] * feed - drawn)) / (
            1.0 + STEP / capacitance * feed
        )
        volts = max(volts, 0.5 * source[knot])
        if blocked:
            excess = (volts - source[knot] - rise) * capacitance / STEP * volts
            burn = max(burn + excess, 0.0)
            volts = min(volts, source[knot] + rise)
        for d in range(count):
            s = state[d]
            s.burned = burn * s.back / max(returned, 1e-9)
