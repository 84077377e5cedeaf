"""Whole recordings of true plants in memory, with the truth of each drive beside them."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from power_recordings.alignment.align import RATES, align
from power_recordings.alignment.dataset import AlignedDataset
from power_recordings.messages.samples import DriveSamples, JointSamples
from power_recordings.reading.reader import Recording
from wattwalk_core.anymal import JOINT_NAMES
from wattwalk_core.arrays import Floats, Singles

from truths.families import FAMILIES, TruePlant
from truths.motions import MOTIONS, Asked
from truths.parameters import Drive, table
from truths.steps import KNOT, PART, PARTS, STATE, STEP, run

START_NS = 1_750_000_000_000_000_000
_OVERSAMPLED = 1.9  # rate of the alignment against the joints', as the lab takes it


@dataclass(frozen=True)
class Case:
    """Recipe of a recording; hidden: effects that exist and that the base model lacks."""

    family: str
    motion: str
    seconds: float = 150.0
    drives: int = 3
    seed: int = 0
    hidden: tuple[str, ...] = ()
    strength: float = 1.0  # of what is hidden, against its usual size
    plant_seed: int | None = None  # the seed, if None: other runs of one plant share it

    @property
    def key(self) -> str:
        """Key of the case in a file of results."""
        what = (self.family, self.motion, f'{self.seconds:g}', self.drives)
        hidden = ('+'.join(self.hidden), f'{self.strength:g}')
        return '|'.join(map(str, (*what, *hidden, self.seed, self.plant_seed)))


@dataclass(frozen=True)
class Recorded:
    """A recording with its truth.

    coefficients: by drive and name. power: true W at the meter at 50 Hz [P, D]; parts: the same
    by part [P, D, len(PARTS)].
    """

    case: Case
    plant: TruePlant
    data: AlignedDataset
    coefficients: Mapping[str, Mapping[str, float]]
    power: Singles
    parts: Singles

    @property
    def known(self) -> tuple[str, ...]:
        """Effects of the base model, which heats a winding by its measured temperature."""
        return ('shaft', *sorted(self.plant.judged - self.missing))

    @property
    def missing(self) -> frozenset[str]:
        """Effects of the catalogue that a perfect diagnosis names."""
        return self.plant.judged & {*_not_in_model(self.case, self.plant)}


def record(case: Case) -> Recorded:
    """Draw the plant, run the motion, measure and align."""
    plant = draw(case)
    made = simulate(case, plant)
    data, parts = aligned(case.key, plant, made), made.parts
    coefficients = {
        name: _coefficients(plant.drives[place], parts[:, place], made.state[place])
        for place, name in enumerate(data.names)
    }
    return Recorded(case, plant, data, coefficients, made.power, parts)


def hidden_watts(case: Case, *, apart: bool = False) -> dict[str, float]:
    """W rms over all drives by which each effect that the model lacks changes the metered power.

    apart: only what the true power of the known effects, each times any factor, cannot take over.
    """
    changes, known = _changes(case)
    if apart:
        changes = {name: _left(changed, known) for name, changed in changes.items()}
    return {name: float(np.sqrt(np.square(changed).mean())) for name, changed in changes.items()}


@lru_cache(maxsize=1)
def _changes(case: Case) -> tuple[dict[str, Floats], Floats]:
    """W by which what the model lacks changes the power [P, D], and known effects' [P, D, n]."""
    plant = draw(case)
    lacking = _not_in_model(case, plant)
    if not lacking:
        return {}, np.empty((0, case.drives, 0))
    made = simulate(case, plant)
    changes = {}
    for name in lacking:
        if name == 'cross_talk':
            changes[name] = made.power * [drive.cross_talk for drive in plant.drives]
        else:
            without = simulate(case, plant.only(plant.exists - {name})).power
            changes[name] = np.asarray(made.power - without, np.float64)
    of_model = {'shaft', *plant.judged} - {*lacking}
    known = [place for place, name in enumerate(PARTS) if name in of_model]
    return changes, made.parts[..., known].astype(np.float64)


def _not_in_model(case: Case, plant: TruePlant) -> tuple[str, ...]:
    """Effects that are hidden, and the heating of a winding whose temperature is not measured."""
    unmeasured = {'winding_heating'} & plant.exists - {*case.hidden}
    return case.hidden if plant.sampling.temperature else (*case.hidden, *sorted(unmeasured))


def _left(changed: Floats, known: Floats) -> Floats:
    """What factors of the known effects' power [P, D, n] leave of a change [P, D]."""
    left = np.empty_like(changed)
    for d in range(changed.shape[1]):
        factors = np.linalg.lstsq(known[:, d], changed[:, d], rcond=None)[0]
        left[:, d] = changed[:, d] - known[:, d] @ factors
    return left


def draw(case: Case) -> TruePlant:
    """Draw the plant of a case."""
    seed = case.seed if case.plant_seed is None else case.plant_seed
    family = FAMILIES[case.family]
    entropy = [seed, *case.family.encode()]
    return family.draw(np.random.default_rng(entropy), case.drives, case.hidden, case.strength)


@dataclass(frozen=True)
class Simulated:
    """Readings of D drives with their stamps, and the truth beside them."""

    joint_time: Floats  # s [N]
    joints: Floats  # position, velocity, torque, winding temperature [4, D, N]
    meter_time: Floats  # s [M]
    meter: Floats  # voltage, current [2, D, M]
    power: Singles  # W at the meter at 50 Hz [P, D]
    parts: Singles  # W [P, D, len(PARTS)]
    state: NDArray[np.void]  # of the drives at the end [D]


def simulate(
    case: Case, plant: TruePlant, load: float = 1.0, added: Floats | float = 0.0
) -> Simulated:
    """Run a plant through the motion of a case and read its instruments.

    load: factor of the torque that the motion asks for; added: N·m to it [K, D].
    """
    random = np.random.default_rng([case.seed, *case.motion.encode(), 3])
    count, drives = int(case.seconds / (KNOT * STEP)) + 3, table(plant.drives)
    ask = Asked(random, count, drives['speed_limit'], drives['torque_limit'])
    position, torque = MOTIONS[case.motion](ask)
    torque = torque * load + added
    supply, sampling = plant.supply, plant.sampling
    time = ask.time
    other = supply.electronics + supply.electronics_spread * ask.wander(8.0, 1)[:, 0]
    source = supply.voltage - supply.discharge * time / 600.0
    steps = (count - 3) * KNOT
    joint_time, joint_at = _instants(random, steps, sampling.joint_rate, plant, 0.0)
    meter_time, meter_at = _instants(
        random, steps, sampling.meter_rate, plant, sampling.meter_delay
    )
    joints = np.zeros((4, len(drives), len(joint_time)))
    meter = np.zeros((2, len(drives), len(meter_time)))
    parts = np.zeros((steps // PART, len(drives), len(PARTS)), np.float32)
    power = np.zeros((steps // PART, len(drives)), np.float32)
    state = np.zeros(len(drives), STATE)
    bus = np.array(
        [
            *(supply.voltage, supply.resistance, supply.capacitance),
            *(float(supply.blocked), supply.chopper_rise),
        ]
    )
    run(
        drives, state, position, torque, source, np.maximum(other, 0.0), bus,
        joint_at, meter_at, joints, meter, parts, power,
    )  # fmt: skip
    noise = random.standard_normal(joints[:3].shape)
    joints[0] += sampling.position_noise * noise[0]
    joints[1] += sampling.velocity_noise * drives['speed_limit'][:, None] * noise[1]
    joints[2] += sampling.torque_noise * drives['torque_limit'][:, None] * noise[2]
    noise = random.standard_normal(meter.shape)
    mixed = meter[1] + drives['cross_talk'][:, None] * np.roll(meter[1], 1, axis=0)
    meter[1] = mixed * drives['meter_gain'][:, None] + drives['meter_offset'][:, None]
    meter[1] += sampling.current_noise * noise[1]
    meter[0] += sampling.voltage_noise * noise[0]
    return Simulated(joint_time, joints, meter_time, meter, power, parts, state)


def _instants(
    random: np.random.Generator, steps: int, rate: float, plant: TruePlant, delay: float
) -> tuple[Floats, NDArray[np.int64]]:
    """Stamps in s [N] and steps at which each drive is truly read [D, N]."""
    count = int(steps * STEP * rate) - 2
    even = (np.arange(count) + 1.0) / rate
    stamp = even + random.uniform(0, plant.sampling.jitter, count) / rate
    late = delay + np.sort(random.uniform(0, 1, len(plant.drives))) * plant.sampling.skew
    at = np.clip(np.rint((stamp + late[:, None]) / STEP), 0, steps - 1).astype(np.int64)
    return stamp, np.maximum.accumulate(at, axis=1)


def aligned(name: str, plant: TruePlant, made: Simulated) -> AlignedDataset:
    """Align the streams as the lab would, had they been read from a bag."""
    joint_time, meter_time = made.joint_time, made.meter_time
    count = made.joints.shape[1]
    names = JOINT_NAMES[:count] if count > 1 else ('LF_KFE',)
    if len(names) < count:
        names = tuple(f'J{place + 1}' for place in range(count))
    position, velocity, effort, winding = (values.T.astype(np.float32) for values in made.joints)
    voltage, current = (values.T.astype(np.float32) for values in made.meter)
    at = START_NS + np.rint(meter_time * 1e9).astype(np.int64)
    warm = np.full(voltage.shape, np.nan, np.float32)
    if plant.sampling.temperature:
        before = np.searchsorted(joint_time, meter_time).clip(0, len(joint_time) - 1)
        warm = np.rint(winding[before] * 10.0) / np.float32(10.0)
    number = np.arange(len(at), dtype=np.uint64)
    stamps = START_NS + np.rint(joint_time * 1e9).astype(np.int64)
    recording = Recording.in_memory(
        name,
        {
            'joint_states': JointSamples(stamps, names, position, velocity, effort),
            'drive_supply': DriveSamples(
                at, names, number, at.astype(np.uint64), voltage, current, warm,
                np.zeros(voltage.shape, np.uint8),
            ),
        },
    )  # fmt: skip
    period = float(np.median(np.diff(joint_time)))
    rate = min((rate for rate in RATES if rate * period >= _OVERSAMPLED), default=max(RATES))
    data = align(recording, rate=rate, smooth=False)
    at_motor = [n for n, drive in zip(names, plant.drives, strict=True) if drive.torque_at_motor]
    return replace(data, motor_torque=frozenset(at_motor))


def _coefficients(drive: Drive, own: Singles, state: np.void) -> dict[str, float]:
    squared = max(float(state['squared']), 1e-12)
    housing = state['warmth'] / (len(own) * PART)
    thin = float(np.exp(-drive.grease * (housing - 25.0)))
    at_one = drive.coulomb + drive.stribeck / (1 + (1 / drive.stribeck_speed) ** 2)
    at_one += drive.viscous * thin
    share = drive.load_friction * (1 + drive.load_with_speed / drive.speed_limit)
    return {
        'k': (drive.resistance + drive.device_resistance) / drive.torque_constant**2,
        'k_warm': float(state['effective']) / squared,
        'inertia': drive.inertia,
        'idle': float(own[:, PARTS.index('idle')].mean()),
        'spring': 1 / drive.stiffness if drive.stiffness else 0.0,
        'friction_at_1': at_one,
        'load_friction': share * float(np.sqrt(thin)),
        'iron_at_1': drive.iron,
        'line': drive.line,
        'torque_scale': drive.torque_scale,
        'meter_gain': drive.meter_gain,
        'inverter': float(own[:, PARTS.index('inverter_loss')].mean()),
    }
