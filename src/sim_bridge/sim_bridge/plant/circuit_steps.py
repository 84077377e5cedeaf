"""Steps of circuit and bus, compiled: powers of D drives in B steps."""

from math import exp, sqrt
from typing import Final

from wattwalk_core.arrays import Floats
from wattwalk_core.compiled import compiled

CIRCUIT: Final = (
    *('torque_limit', 'torque_constant', 'saturation', 'hysteresis', 'hysteresis_exponent'),
    *('eddy', 'eddy_exponent', 'cold_resistance', 'modulation', 'reactance', 'rated_reactance'),
    *('most_weakening', 'device_drop', 'device_resistance', 'switching_share', 'lost_back'),
    *('idle', 'fan', 'fan_period', 'phase'),
)
"""Rows of the table of a circuit [20, D]."""
_TINY: Final = 1e-9


@compiled(
    'void(f8[:, ::1], f8[::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[::1], f8, f8, f8, b1,'
    ' f8[:, :, ::1], f8[:, ::1])'
)
def circuit_steps(
    table: Floats,
    resistance: Floats,
    motor: Floats,
    speed: Floats,
    drag: Floats,
    time: Floats,
    voltage: float,
    level: float,
    inverter: float,
    weakening: bool,
    flow: Floats,
    heat: Floats,
) -> None:
    """Write powers and currents to flow [9, B, D], in the order of `Flow`, and add to heat [2, D].

    table: rows of CIRCUIT; resistance: ohm [D]; motor, speed, drag: N·m, rad/s, N·m [B, D]; time:
    s [B]; voltage: V; level: share of the idle draw; inverter: its scale; weakening: whether the
    drives weaken their field. heat: sums of powers into windings and housings, W.
    """
    steps, drives = motor.shape
    available = table[8, 0] * voltage
    needed = False
    for b in range(steps):
        for d in range(drives):
            pull = motor[b, d] / table[0, d]
            constant = table[1, d] / (1.0 + table[2, d] * pull * pull)
            fast = abs(speed[b, d])
            iron = table[3, d] * fast ** table[4, d] + table[5, d] * fast ** table[6, d]
            dragging = iron * speed[b, d] / (constant * (fast * fast + _TINY))
            current = motor[b, d] / constant + dragging
            available = table[8, d] * voltage
            if constant * fast + table[7, d] * abs(current) > 0.8 * available:
                needed = weakening
            flow[0, b, d] = constant
            flow[2, b, d] = dragging * (constant * speed[b, d])
            flow[8, b, d] = current
    for b in range(steps):
        for d in range(drives):
            constant, iron, current = flow[0, b, d], flow[2, b, d], flow[8, b, d]
            fast = abs(speed[b, d])
            field = 0.0
            if needed:
                available = table[8, d] * voltage
                across = table[9, d] * fast * current
                induced = sqrt(max(available * available - across * across, 0.0))
                induced -= table[7, d] * abs(current)
                excess = max(constant - induced / max(fast, 0.1), 0.0)
                field = min(excess / table[10, d], table[11, d])
            through = sqrt(current * current + field * field)
            copper = resistance[d] * current * current
            field_loss = resistance[d] * field * field
            drop = table[12, d] + table[13, d] * through + table[14, d] * voltage
            switches = inverter * through * drop
            bridge = (resistance[d] * current + constant * speed[b, d]) * current
            bridge = bridge + field_loss + switches
            lost = table[15, d] * max(-bridge, 0.0)
            idle = table[16, d] * level
            fan = 0.0
            if table[17, d] != 0.0:
                turn = (time[b] / table[18, d] + table[19, d]) % 1.0
                running = 1.0 / (1.0 + exp(-80.0 * (turn - 0.55)))
                fan = table[17, d] * (running - 1.0 / (1.0 + exp(-80.0 * (turn - 0.97))))
            flow[0, b, d] = bridge + lost + idle + fan
            flow[1, b, d] = copper
            flow[3, b, d] = switches
            flow[4, b, d] = field_loss
            flow[5, b, d] = idle
            flow[6, b, d] = fan
            flow[7, b, d] = lost
            heat[0, d] += copper + field_loss
            heat[1, d] += 0.5 * (iron + switches) + idle + drag[b, d] * speed[b, d]


@compiled('UniTuple(f8, 3)(f8, f8, f8, f8, f8, f8, f8)')
def bus_step(
    power: float,
    before: float,
    capacity: float,
    conductance: float,
    source: float,
    ceiling: float,
    blocked: float,
) -> tuple[float, float, float]:
    """Return voltage, V, power burned, W, and supply current, A, of one implicit step of a bus.

    power: drawn, W; before: voltage, V; capacity: F/s; conductance: 1/ohm, to the source, V.
    ceiling: V, of the choppers; blocked: share of the power that the diode holds back.
    """
    a = capacity + conductance
    b = capacity * before + conductance * source
    voltage = (b + sqrt(max(b * b - 4.0 * a * power, 0.0))) / (2.0 * a)
    if voltage <= source or blocked == 0.0:
        return voltage, 0.0, (source - voltage) * conductance
    kept = blocked * power if power < 0.0 else power
    b = capacity * before
    voltage = (b + sqrt(max(b * b - 4.0 * capacity * kept, 0.0))) / (2.0 * capacity)
    burn = 0.0
    if voltage > ceiling:
        voltage = ceiling
        burn = max(-kept - voltage * capacity * (voltage - before), 0.0)
    return voltage, burn, (power - kept) / voltage


@compiled('f8(f8, f8, f8)')
def line_loss(link: float, line: float, voltage: float) -> float:
    """Return the loss in a cable of line ohm, W, that feeds link, W, from voltage, V."""
    root = sqrt(max(voltage * voltage - 4.0 * line * link, 0.0))
    current = 2.0 * link / (voltage + root)
    return line * (current * current)


@compiled('f8(f8[:, ::1], f8[::1], f8, f8, f8, f8, f8, f8, b1, f8[:, ::1], f8[:, :, ::1])')
def bus_steps(
    link: Floats,
    line: Floats,
    before: float,
    capacity: float,
    conductance: float,
    source: float,
    ceiling: float,
    blocked: float,
    in_drives: bool,
    series: Floats,
    powers: Floats,
) -> float:
    """Write B steps of a bus to series [5, B] and powers [3, B, D]; return the last voltage, V.

    link: drawn at the DC links, W [B, D]; line: ohm [D]; in_drives: whether choppers sit behind
    the meter; the others as of `bus_step`. series: voltage, supply current, supply loss,
    capacitor loss, stored. powers: at the meter, in the lines, burned.
    """
    steps, drives = link.shape
    first = before
    for b in range(steps):
        total = 0.0
        for d in range(drives):
            total += link[b, d] + line_loss(link[b, d], line[d], before)
        first, _, _ = bus_step(total, first, capacity, conductance, source, ceiling, blocked)
        series[0, b] = first
    last = before
    for b in range(steps):
        total, back = 0.0, 0.0
        for d in range(drives):
            loss = line_loss(link[b, d], line[d], series[0, b])
            power = link[b, d] + loss
            powers[0, b, d], powers[1, b, d] = power, loss
            total += power
            back += max(-power, 0.0)
        voltage, burn, current = bus_step(
            total, last, capacity, conductance, source, ceiling, blocked
        )
        for d in range(drives):
            burned = burn * (max(-powers[0, b, d], 0.0) / max(back, 1e-12))
            powers[2, b, d] = burned
            if in_drives:
                powers[0, b, d] += burned
        change = voltage - last
        series[0, b], series[1, b] = voltage, current
        series[2, b] = (source - voltage) * current
        series[3, b] = 0.5 * capacity * change * change
        series[4, b] = capacity * change * (voltage - 0.5 * change)
        last = voltage
    return last
