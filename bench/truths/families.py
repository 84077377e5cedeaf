"""Families of true plants: each draws its drives, supply and sampling from a seed."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from truths.parameters import Drive, Sampling, Supply

Draw = np.random.Generator
JOINT = Drive(stribeck_speed=0.5)
GIMBAL = Drive(
    torque_limit=1.0, speed_limit=40.0, torque_constant=0.12, resistance=0.8, inertia=8e-5,
    current_loop=900.0, ripple_order=42.0, coulomb=0.012, stribeck_speed=1.0, viscous=0.0005,
    presliding_speed=0.15, iron=0.006, pole_pairs=14.0, idle=1.2, winding_capacity=9.0,
    winding_conductance=0.3, housing_capacity=70.0, housing_conductance=0.35, current_gain=1.0,
    rub_width=0.2, velocity_filter=80.0,
)  # fmt: skip
WHEEL = Drive(
    torque_limit=15.0, speed_limit=60.0, torque_constant=0.5, resistance=0.14, inertia=0.006,
    coulomb=0.12, stribeck_speed=2.0, viscous=0.006, presliding_speed=0.3, iron=0.06,
    pole_pairs=20.0, ripple_order=120.0, idle=2.6, winding_capacity=140.0,
    winding_conductance=1.2, housing_capacity=1500.0, housing_conductance=1.4, current_gain=0.6,
)  # fmt: skip
ARM = Drive(
    torque_limit=250.0, speed_limit=2.6, torque_constant=16.0, resistance=0.7, inertia=1.6,
    coulomb=8.0, stribeck_speed=0.2, viscous=9.0, presliding_speed=0.01, iron=1.2,
    pole_pairs=1200.0, ripple_order=202.0, idle=11.0, winding_capacity=300.0,
    winding_conductance=2.2, housing_capacity=5000.0, housing_conductance=2.5,
)  # fmt: skip
ALWAYS = ('copper_loss', 'idle', 'coulomb_friction', 'viscous_friction', 'rotor_inertia')
ABSENT: Mapping[str, Mapping[str, float]] = {
    'copper_loss': {'resistance': 0.0},
    # Copper has its temperature coefficient in any drive: this one hardly warms.
    'winding_heating': {'winding_capacity': 1e9, 'magnet_temperature': 0.0},
    'coulomb_friction': {'coulomb': 0.0},
    'viscous_friction': {'viscous': 0.0},
    'stribeck_friction': {'stribeck': 0.0},
    'load_friction': {'load_friction': 0.0},
    'rotor_inertia': {'inertia': 0.0},
    'spring': {'stiffness': 0.0},
    'cogging': {'cogging': 0.0},
    'iron_loss': {'iron': 0.0},
    'inverter_loss': {
        'device_drop': 0.0, 'device_resistance': 0.0, 'switching': 0.0, 'dead_time': 0.0
    },
    'idle': {'idle': 0.0},
    'line_resistance': {'line': 0.0},
    'regeneration_efficiency': {'returned': 1.0},
    'field_weakening': {'weakening': 0.0},
    'regeneration_limit': {},
    'position_rub': {'rub': 0.0},
    'fan': {'fan': 0.0},
    'cross_talk': {'cross_talk': 0.0},
}  # fmt: skip
"""What a plant lacks without each effect; the last three are in no catalogue."""
SIZE: Mapping[str, tuple[str, ...]] = {
    'winding_heating': ('copper_temperature',),
    'rotor_inertia': ('inertia',),
    'spring': (),
    'regeneration_limit': (),
}
"""What makes an effect larger, where it is not what its absence sets to 0."""
UNMODELLED = ('position_rub', 'fan', 'cross_talk')
IN_MOTOR_TORQUE = (
    *('coulomb_friction', 'viscous_friction', 'stribeck_friction', 'load_friction'),
    *('rotor_inertia', 'spring', 'cogging', 'iron_loss'),
)
"""Effects that torque computed from the current has in it, which power cannot lack beside it."""


@dataclass(frozen=True)
class TruePlant:
    """One plant as drawn; `exists` are the effects by the catalogue's names that are in it."""

    drives: tuple[Drive, ...]
    supply: Supply
    sampling: Sampling
    exists: frozenset[str]

    @property
    def judged(self) -> frozenset[str]:
        """Effects of the catalogue that a model of the power can have or lack."""
        at_motor = any(drive.torque_at_motor for drive in self.drives)
        return self.exists - {*UNMODELLED, *(IN_MOTOR_TORQUE if at_motor else ())}

    def stronger(self, effects: Sequence[str], factor: float) -> 'TruePlant':
        """Return the plant with these effects so many times as large."""
        names = [name for effect in effects for name in SIZE.get(effect, ABSENT[effect])]
        drives = []
        for drive in self.drives:
            sizes = {name: getattr(drive, name) * factor for name in names}
            if 'returned' in sizes:
                sizes['returned'] = max(1 - factor * (1 - drive.returned), 0.0)
            drives.append(replace(drive, **sizes))
        return replace(self, drives=tuple(drives))

    def only(self, effects: frozenset[str]) -> 'TruePlant':
        """Return the plant with these effects alone."""
        gone: dict[str, float] = {}
        for name in ABSENT.keys() - effects:
            gone |= ABSENT[name]
        if 'spring' in effects:
            gone.pop('inertia', None)
        supply = replace(self.supply, blocked='regeneration_limit' in effects)
        drives = tuple(replace(drive, **gone) for drive in self.drives)
        return replace(self, drives=drives, supply=supply, exists=effects)


@dataclass(frozen=True)
class Family:
    """Plants of one kind.

    change: draws what differs from the scale, by the drive's fields. often: chances that effects
    beside those that always exist are in the plant. developed: whether the lab may be developed on
    it; the others are scored in a column of their own.
    """

    scale: Drive
    change: Callable[[Draw], Mapping[str, float]]
    supply: Callable[[Draw], Supply]
    sampling: Callable[[Draw], Sampling]
    motions: tuple[str, ...]
    often: Mapping[str, float] = field(default_factory=dict)
    always: tuple[str, ...] = ALWAYS
    spread: float = 0.1  # of every figure of the drive, from drive to drive
    developed: bool = True

    def draw(
        self, random: Draw, drives: int, hidden: Sequence[str], strength: float = 1.0
    ) -> TruePlant:
        """Draw a plant of D drives in which the hidden effects exist, so many times as large."""
        whole = _typical(self.scale) | dict(self.change(random))
        # Its own stream, so that plants of a seed stay as they are.
        whole['cogging_order'] = float(random.spawn(1)[0].choice(_COGS))
        spread = {name: random.lognormal(0.0, self.spread) for name in _SPREAD}
        made = []
        for _ in range(drives):
            values = dict(whole)
            for name in _SPREAD:
                single = random.lognormal(0.0, self.spread / 2)
                values[name] = values[name] * spread[name] * single
            values['phase'] = random.uniform(0.0, 2 * np.pi)
            made.append(Drive(**values))
        chance = {name: random.random() for name in self.often}
        exists = {name for name, share in self.often.items() if chance[name] < share}
        exists |= set(self.always) | set(hidden)
        supply = self.supply(random)
        supply = replace(supply, resistance=supply.resistance * min(1.0, 3 / drives))
        plant = TruePlant(tuple(made), supply, self.sampling(random), frozenset())
        return plant.only(frozenset(exists)).stronger(hidden, strength)


_COGS = (18, 24, 36, 42, 60, 72, 84, 90, 126, 144)  # multiples of usual slots and poles
_SPREAD = (
    *('torque_constant', 'resistance', 'inertia', 'coulomb', 'stribeck', 'viscous', 'iron'),
    *('idle', 'line', 'load_friction', 'device_drop', 'winding_capacity', 'stiffness'),
)


def _typical(scale: Drive) -> dict[str, float]:
    """Fields of a scale with every effect at its usual size."""
    values = {name: getattr(scale, name) for name in Drive.__dataclass_fields__}
    return values | {
        'rub': 0.06 * scale.torque_limit,
        'rub_angle': 0.05,
        'fan': 0.6 * scale.idle,
        'cross_talk': 0.06,
        'stribeck': 0.6 * scale.coulomb,
        'load_friction': 0.08,
        'stiffness': 5.5 * scale.torque_limit,
        'cogging': 0.004 * scale.torque_limit,
        'device_drop': 0.35,
        'device_resistance': 0.04 * scale.resistance,
        'switching': 0.004,
        'line': 0.2 * scale.resistance,
        'returned': 0.8,
        'weakening': 0.3,
    }


def stiff(random: Draw) -> Supply:
    """Bench supply."""
    return Supply(resistance=random.uniform(0.005, 0.03), electronics=random.uniform(0, 80))


def battery(random: Draw) -> Supply:
    """Battery that sags by its current and empties."""
    return Supply(
        resistance=random.uniform(0.05, 0.2),
        discharge=random.uniform(0.3, 1.2),
        electronics=random.uniform(30, 200),
        electronics_spread=random.uniform(3, 15),
    )


def clean(random: Draw) -> Sampling:
    """Latched bus: joints at 400 Hz, meter at 1 kHz."""
    return Sampling(meter_delay=random.uniform(0.0, 0.003))


def polled(random: Draw) -> Sampling:
    """Drives asked one after another, each answer a little older than it says."""
    rate = random.choice([50.0, 100.0])
    return Sampling(
        joint_rate=rate,
        meter_rate=random.choice([20.0, 50.0, 100.0]),
        jitter=random.uniform(0.02, 0.1),
        skew=random.uniform(0.0, 0.3) / rate,
        meter_delay=random.uniform(-0.005, 0.01),
        temperature=bool(random.random() < 0.5),
    )


def _rigid(random: Draw) -> dict[str, float]:
    return {'torque_bias': random.normal(0, 0.1), 'meter_gain': random.normal(1, 0.005)}


def _measured(random: Draw, limit: float) -> dict[str, float]:
    """Errors of sensors as they are sold."""
    return {
        'torque_scale': 1 + random.uniform(-0.1, 0.1),
        'torque_bias': random.normal(0, 0.002) * limit,
        'torque_hysteresis': random.uniform(0.0, 0.0125) * limit,
        'meter_gain': 1 + random.uniform(-0.06, 0.06),
        'meter_offset': random.normal(0, 0.02),
        'meter_filter': np.exp(random.uniform(np.log(15.0), np.log(300.0))),
    }


def _elastic(random: Draw) -> dict[str, float]:
    return {
        'torque_loop': random.uniform(30, 70),
        'loop_delay': random.uniform(0.3e-3, 1e-3),
        'torque_ripple': random.uniform(0.005, 0.03),
        'stiffness': 80.0 * random.uniform(3.0, 9.0),
        'torque_hysteresis': random.uniform(0.0, 1.0),
        'speed_exponent': random.uniform(0.8, 1.2),
        'grease': random.uniform(0.0, 0.01),
        'saturation': random.uniform(0.0, 0.1),
    }


def _harmonic(random: Draw, limit: float) -> dict[str, float]:
    return {
        'speed_exponent': random.uniform(0.6, 1.4),
        'load_friction': random.uniform(0.04, 0.15),
        'load_with_speed': random.uniform(0.0, 0.5),
        'grease': random.uniform(0.005, 0.02),
        'start': random.uniform(18.0, 40.0),
        'eccentric_drag': random.uniform(0.0, 0.3),
        'torque_ripple': random.uniform(0.0, 0.02),
        'torque_hysteresis': random.uniform(0.0, 0.006) * limit,
    }


def _motor(random: Draw) -> dict[str, float]:
    """Motor whose torque is computed from its current."""
    return {
        'torque_at_motor': 1.0,
        'torque_scale': 1 + random.uniform(-0.1, 0.1),
        'magnet_temperature': random.uniform(0.0005, 0.0015),
        'saturation': random.uniform(0.0, 0.15),
        'dead_time': random.uniform(0.0, 0.03),
        'encoder_error': random.uniform(0.0, 3e-3),
        'torque_ripple': random.uniform(0.0, 0.03),
    }


_MANY = {
    'winding_heating': 0.5, 'stribeck_friction': 0.4, 'load_friction': 0.6, 'iron_loss': 0.6,
    'inverter_loss': 0.6, 'line_resistance': 0.3, 'regeneration_efficiency': 0.2,
}  # fmt: skip

FAMILIES: Mapping[str, Family] = {
    'rigid': Family(JOINT, _rigid, stiff, clean, ('walk', 'ladder', 'arm'), _MANY),
    'elastic': Family(
        JOINT, _elastic, stiff, clean, ('walk', 'ladder', 'hopper'), _MANY, (*ALWAYS, 'spring')
    ),
    'sensors': Family(
        JOINT,
        lambda r: _measured(r, 80.0),
        stiff,
        clean,
        ('walk', 'ladder', 'arm', 'stall'),
        _MANY,
    ),
    'harmonic': Family(
        ARM,
        lambda r: _harmonic(r, 250.0),
        lambda r: replace(battery(r), discharge=0.0),
        lambda r: replace(clean(r), joint_rate=200.0, meter_rate=500.0),
        ('arm', 'ladder'),
        _MANY | {'load_friction': 1.0},
    ),
    'gimbal': Family(
        GIMBAL,
        _motor,
        lambda r: replace(stiff(r), voltage=24.0, electronics=5.0),
        polled,
        ('ladder', 'arm', 'stall', 'hopper'),
        {'winding_heating': 0.6, 'inverter_loss': 0.6, 'iron_loss': 0.5, 'line_resistance': 0.3},
    ),
    'wheel': Family(
        WHEEL,
        lambda r: _motor(r) | {'meter_gain': 1 + r.uniform(-0.06, 0.06)},
        lambda r: replace(battery(r), voltage=36.0, electronics=30.0),
        polled,
        ('wheel', 'ladder'),
        {'winding_heating': 0.6, 'inverter_loss': 0.6, 'iron_loss': 0.8, 'line_resistance': 0.3},
        developed=False,
    ),
    'robot': Family(
        JOINT,
        lambda r: _elastic(r) | _harmonic(r, 80.0) | _measured(r, 80.0) | {
            'magnet_temperature': 0.001, 'dead_time': r.uniform(0.0, 0.03),
            'encoder_error': r.uniform(0.0, 2e-3),
        },
        battery,
        polled,
        ('walk', 'ladder', 'hopper'),
        _MANY | {'regeneration_limit': 0.2, 'cogging': 0.5},
        (*ALWAYS, 'spring'),
        developed=False,
    ),
}  # fmt: skip
