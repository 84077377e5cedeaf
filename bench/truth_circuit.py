"""A second source of truth for the lab, apart from sim_bridge and from the lab's own formulas.

Three drives of a leg as circuits: currents and voltages are worked out first, power is their
product at the meter. Shapes differ from the catalogue's formulas on purpose.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from power_recordings.alignment.dataset import AlignedDataset
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d
from scipy.signal import butter, lfilter, sosfilt
from wattwalk_core.arrays import Floats

RATE = 2000.0
NAMES = ('LF_HAA', 'LF_HFE', 'LF_KFE')
TYPICAL: dict[str, float] = {
    'copper_loss': 0.45,  # ohm
    'winding_heating': 0.0039,  # 1/K
    'viscous_friction': 3.0,  # N·m·s/rad
    'coulomb_friction': 2.0,  # N·m
    'stribeck_friction': 3.0,  # N·m
    'load_friction': 0.10,
    'iron_loss': 0.5,
    'inverter_loss': 0.9,  # V drop
    'idle': 8.5,  # W
    'regeneration_efficiency': 0.35,
    'regeneration_limit': 1.0,
    'field_weakening': 2.0,
    'rotor_inertia': 0.07,  # kg·m²
    'spring': 1 / 181.0,  # rad/(N·m)
    'cogging': 1.5,  # N·m
    'line_resistance': 0.25,  # ohm
    'position_rub': 5.0,  # N·m
    'fan': 5.0,  # W
    'cross_talk': 0.06,
}
CONSTANT: dict[str, float] = {
    'one_way_friction': 3.0,  # N·m while the motor turns forwards
    'offset_torque': 2.0,  # N·m
}
"""What a constant torque imitates."""
UNMODELLED = ('position_rub', 'fan', 'cross_talk')


@dataclass(frozen=True)
class Faults:
    """Errors of the measurement."""

    delay: float = 0.0015  # s, of the power
    gain: float | Floats = 0.0
    current_offset: float | Floats = 0.0  # A
    torque_bias: float = 0.0  # N·m
    velocity_filter: float = 40.0  # Hz
    offset_drift: float = 0.0  # A per minute
    torque_bend: float = 0.0  # gain error of the torque sensor at 40 N·m


@dataclass(frozen=True)
class Truth:
    """Active effects as multiples of TYPICAL, and the motion."""

    effects: Mapping[str, float | Floats]  # a number for all drives, or one for each
    motion: str = 'walk'
    seconds: float = 150.0
    seed: int = 0
    unit: int = 0
    faults: Faults = field(default_factory=Faults)
    pace: float = 1.0  # of the gait, against the usual one
    payload: float = 1.0  # torque against the usual one


def record(truth: Truth) -> AlignedDataset:
    """Simulate a truth and return its measured signals, at 400 Hz."""
    rng = np.random.default_rng([truth.seed, 7])
    steps = int(truth.seconds * RATE)
    if truth.motion == 'walk':
        position, velocity, torque = _walk(rng, steps, truth.pace)
    else:
        position, velocity, torque = _ladder(rng, steps)
    torque = torque * truth.payload
    acceleration = np.gradient(velocity, 1 / RATE, axis=0)
    power, voltage = _circuit(truth, position, velocity, acceleration, torque)
    return _measure(truth, rng, position, velocity, torque, power, voltage)


def _smooth(values: Floats, seconds: float) -> Floats:
    skip = max(1, int(seconds * RATE / 10))
    if skip == 1:
        return gaussian_filter1d(values, seconds * RATE, axis=0)
    coarse = gaussian_filter1d(values[::skip], seconds * RATE / skip, axis=0)
    places, known = np.arange(len(values)), np.arange(len(coarse)) * skip
    return CubicSpline(known, coarse, axis=0)(np.minimum(places, known[-1]))


def _noise(rng: np.random.Generator, steps: int, seconds: float) -> Floats:
    """Smooth noise of unit size [steps, 3]."""
    noise = _smooth(rng.standard_normal((steps, 3)), seconds)
    return noise / noise.std(axis=0)


def _walk(
    rng: np.random.Generator, steps: int, usual: float = 1.0
) -> tuple[Floats, Floats, Floats]:
    hold = np.repeat(rng.uniform(-1, 1, (steps // int(3 * RATE) + 1, 3)), int(3 * RATE), axis=0)
    command = _smooth(hold[:steps], 0.25)
    pace = (1.6 + 0.25 * command[:, 2]) * usual
    phase = 2 * np.pi * np.cumsum(pace) / RATE
    stance = 1 / (1 + np.exp(-8 * np.sin(phase)))
    speed = 0.25 + 0.55 * np.abs(command[:, 0])
    wobble = _noise(rng, steps, 0.04)
    swing = np.clip(-np.sin(phase), 0, None) ** 1.5
    q = np.empty((steps, 3))
    q[:, 0] = 0.06 * np.sin(phase + 0.4) + 0.16 * command[:, 1] * np.sin(phase)
    q[:, 1] = 0.4 + 0.42 * speed * np.cos(phase) * np.tanh(3 * command[:, 0]) + 0.10 * swing
    q[:, 2] = -0.8 - (0.45 + 0.35 * speed) * swing + 0.05 * np.sin(2 * phase)
    q += 0.010 * wobble
    q = _smooth(q, 0.006)
    w = np.gradient(q, 1 / RATE, axis=0)
    a = np.gradient(w, 1 / RATE, axis=0)
    load, push = _noise(rng, steps, 0.05), _noise(rng, steps, 0.9)
    tau = np.empty((steps, 3))
    tau[:, 0] = stance * (12 + 6 * command[:, 1]) - 3 + 3.0 * load[:, 0] + 3 * push[:, 0]
    tau[:, 1] = stance * (8 * np.sin(phase - 0.6) - 4) + 4.5 * load[:, 1] + 4 * push[:, 1]
    tau[:, 2] = stance * (26 + 6 * speed) - 3 + 5.0 * load[:, 2] + 4 * push[:, 2]
    tau += a * np.array([0.05, 0.10, 0.04]) + 0.2 * w
    return q, w, _smooth(tau, 0.004)


def _ladder(rng: np.random.Generator, steps: int) -> tuple[Floats, Floats, Floats]:
    span = int(1.5 * RATE)
    count = steps // span + 1
    speeds = np.array([0.0, 0.15, 0.4, 1.0, 2.0, 3.5, 5.5, 7.0])
    loads = np.array([0.0, 8.0, 20.0, 32.0])
    speed = np.empty((count, 3))
    for i in range(0, count, 2):
        speed[i] = rng.choice(speeds, 3)
        speed[i + 1 : i + 2] = -speed[i]
    load = rng.choice(loads, (count, 3)) * rng.choice([-1.0, 1.0], (count, 3))
    speed, load = (np.repeat(values, span, axis=0)[:steps] for values in (speed, load))
    w = _smooth(speed, 0.03)
    tau = _smooth(load, 0.05)
    tau += 0.3 * np.gradient(w, 1 / RATE, axis=0)
    tau += 0.3 * _noise(rng, steps, 0.01)
    return np.cumsum(w, axis=0) / RATE, w, tau


def _friction(truth: Truth, s: dict[str, Floats], q: Floats, w: Floats, tau: Floats) -> Floats:
    sign = (2 / np.pi) * np.arctan(w / 0.03)
    one_way = 1 + 0.06 * sign
    drag = s['coulomb_friction'] * sign * one_way
    drag = drag + s['viscous_friction'] * np.sign(w) * np.abs(w) ** 0.94
    drag = drag + s['stribeck_friction'] / (1 + (np.abs(w) / 0.45) ** 2.2) * sign
    drag = drag + s['load_friction'] * np.sqrt(tau**2 + 1.0) * (1 + 0.08 * np.tanh(tau * w)) * sign
    bump = 1 / np.cosh((((q + 0.9) / 0.25 + np.pi) % (2 * np.pi * 3)) - np.pi) ** 2
    if truth.motion == 'walk':
        middle, width = np.quantile(q, 0.7, axis=0), q.std(axis=0) * 0.5 + 0.02
        bump = 1 / (1 + ((q - middle) / width) ** 4)
    drag = drag + s['position_rub'] * bump * sign
    ripple = np.sin(24 * q + 0.7) + 0.2 * np.sin(48 * q)
    drag = drag + s['one_way_friction'] * np.clip(sign, 0.0, None) + s['offset_torque']
    return drag + s['cogging'] * ripple


def _circuit(truth: Truth, q: Floats, w: Floats, a: Floats, tau: Floats) -> tuple[Floats, Floats]:
    """Return power at the meter, W, and voltage, V, of the drives [T, 3]."""
    unit = np.random.default_rng([truth.unit, 11])
    scale = {
        name: TYPICAL[name] * truth.effects.get(name, 0.0) * np.exp(unit.normal(0, 0.08, 3))
        for name in TYPICAL
    }
    scale |= {name: size * truth.effects.get(name, 0.0) for name, size in CONSTANT.items()}
    constant = 5.0 * np.exp(unit.normal(0, 0.02, 3))
    stretch = scale['spring'] * np.gradient(tau, 1 / RATE, axis=0)
    motor_speed = w + stretch
    motor = tau + _friction(truth, scale, q, motor_speed, tau)
    motor = motor + scale['rotor_inertia'] * a
    constant = constant / (1 + 0.03 * (motor / 80) ** 2)
    current = motor / constant
    volts = constant * motor_speed
    iron = scale['iron_loss'] * (np.abs(motor_speed) ** 1.12 + 0.15 * np.abs(motor_speed) ** 1.88)
    iron_current = iron * motor_speed / (constant * (motor_speed**2 + 1e-6))
    through = current + iron_current
    supply = 48.0 + 0.6 * np.sin(2 * np.pi * np.arange(len(q)) / RATE / 37.0)[:, None]
    over = np.maximum(np.abs(motor_speed) - 0.75 * supply / constant, 0)
    weak = scale['field_weakening'] * over / (1 + 0.1 * over)
    resistance = np.broadcast_to(scale['copper_loss'], q.shape)
    if truth.effects.get('winding_heating', 0.0):
        heat = 0.45 * through**2
        winding = 30.0 + _first_order(heat * 1.1, 45.0) + _first_order(heat * 0.8, 400.0)
        resistance = resistance * (1 + scale['winding_heating'] * (winding - 25))
    size = np.sqrt(through**2 + weak**2)
    bridge = volts * through + resistance * size**2
    conduction = np.tanh(size / 0.6) * 0.7 + 0.06 * size**0.5
    bridge = bridge + scale['inverter_loss'] * size * conduction * (0.6 + 0.4 * supply / 48)
    back = np.minimum(bridge, 0)
    bridge = bridge - back * np.clip(scale['regeneration_efficiency'], 0, 1) * np.tanh(-back / 2)
    link = bridge + scale['idle'] * (0.8 + 0.2 * supply / 48)
    phase = (np.arange(len(q)) / RATE / 11.0)[:, None] + np.array([0.0, 0.3, 0.55])
    fan = 1 / (1 + np.exp(-25 * (np.sin(2 * np.pi * phase) - 0.2)))
    link = link + scale['fan'] * fan
    limit = truth.effects.get('regeneration_limit', 0.0)
    if limit:
        net = link.sum(axis=1, keepdims=True)
        returned = np.maximum(-link, 0)
        share = returned / np.maximum(returned.sum(axis=1, keepdims=True), 1e-9)
        link = link + min(limit, 1.0) * np.maximum(-net, 0) * share
    line = scale['line_resistance']
    terminal = supply - line * link / supply
    power = link + line * (link / terminal) ** 2
    reading = power / supply
    mixed = reading + scale['cross_talk'] * np.roll(reading, 1, axis=1)
    return mixed * supply, np.broadcast_to(supply, q.shape)


def _first_order(values: Floats, seconds: float) -> Floats:
    keep = np.exp(-1 / (RATE * seconds))
    return lfilter([1 - keep], [1, -keep], values, axis=0)


def _measure(
    truth: Truth,
    rng: np.random.Generator,
    q: Floats,
    w: Floats,
    tau: Floats,
    power: Floats,
    voltage: Floats,
) -> AlignedDataset:
    faults = truth.faults
    t = np.arange(len(q)) / RATE
    late = np.stack([np.interp(t - faults.delay, t, column) for column in power.T], axis=1)
    current = late / voltage * (1 + faults.gain) + faults.current_offset
    current += faults.offset_drift * (t / 60.0)[:, None]
    current = sosfilt(butter(1, 450.0, fs=RATE, output='sos'), current, axis=0)
    at_1k = current[::2] + rng.normal(0, 0.025, (len(current[::2]), 3))
    at_1k = np.round(at_1k / 0.001) * 0.001
    volts = voltage[::2] + rng.normal(0, 0.01, at_1k.shape)
    watts = at_1k * volts
    times = np.arange(int(len(q) / RATE * 400) - 2) / 400.0
    taken = np.stack([np.interp(times, t[::2], c) for c in _box(watts).T], axis=1)
    velocity = sosfilt(butter(1, faults.velocity_filter, fs=RATE, output='sos'), w, axis=0)
    bent = tau * (1 + faults.torque_bend * (np.abs(tau) / 40.0))

    def sample(values: Floats, noise: float) -> NDArray[np.float32]:
        picked = values[:: int(RATE / 400)][: len(times)]
        return (picked + rng.normal(0, noise, picked.shape)).astype(np.float32)

    return AlignedDataset.blank(
        400.0,
        NAMES,
        times + 100.0,
        f'{truth.motion}_{truth.seed}',
        position=sample(q, 2e-4),
        velocity=sample(velocity, 0.01),
        torque=sample(bent + faults.torque_bias, 0.12),
        command=sample(q, 0.0),
        power=taken,
        voltage=sample(voltage, 0.005),
        current=taken / 48.0,
    )


def _box(values: Floats) -> Floats:
    """Mean of what falls around each 400 Hz instant (2.5 samples of 1 ms)."""
    kernel = np.array([0.25, 0.5, 1.0, 0.5, 0.25])
    padded = np.pad(values, ((0, 2), (0, 0)), 'edge')
    return lfilter(kernel / kernel.sum(), [1], padded, axis=0)[2:]
