"""Questions of the benchmark of reliability: recordings whose truth is known but not told.

Each question knows its key and family, and makes its recording when it is asked.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np
from power_estimator.judge.recordings import energy_window
from power_estimator.posterior.priors import SPIKE
from power_recordings.alignment.align import align
from power_recordings.alignment.dataset import AlignedDataset
from power_recordings.quality.streams import LEAST_UPDATES
from sim_bridge.offline.run import simulate_recording, walking_run
from sim_bridge.plant.parameters import Plant as RobotPlant
from truth_circuit import NAMES
from truths import FAMILIES, UNMODELLED, Case, hidden_watts, record
from truths.families import IN_MOTOR_TORQUE

LENGTHS = (20.0, 40.0, 90.0, 150.0, 300.0, 600.0)  # s
_SHARES = (0.25, 0.15, 0.2, 0.25, 0.1, 0.05)  # of the recordings, by length
_LONG_BUS = 12, 300.0  # drives and s above which a recording takes a judge most of a minute
NAMED_FROM = 0.02
"""Error of a scale or gain from which it is true to say that it is off: beyond a good sensor's."""


REAL = (
    *('torque_loop', 'torque_ripple', 'dead_time', 'magnet_heating', 'battery'),
    *('encoder_eccentricity', 'torque_hysteresis', 'meter_filter'),
)
"""Effects of the simulated robot that no catalogue has, and that real drives have."""


@dataclass(frozen=True)
class Sealed:
    """A recording with its truth.

    known: effects of the base model. missing: effects that it lacks. impossible: effects that
    physics rules out. coefficients: true values by drive and name. watts: RMS change of power by
    each hidden effect. apart: what the known effects leave of it.
    """

    data: AlignedDataset
    known: tuple[str, ...]
    missing: frozenset[str]
    coefficients: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    watts: Mapping[str, float] = field(default_factory=dict)
    apart: Mapping[str, float] = field(default_factory=dict)
    complete: bool = True  # whether all that is missing is in `missing`
    impossible: frozenset[str] = frozenset()
    window: float = 0.0  # s, over which energy is judged, where users have to say --slow-meter


class Question(Protocol):
    """A recording to be judged."""

    @property
    def key(self) -> str:
        """Key in a file of results."""

    @property
    def about(self) -> Mapping[str, object]:
        """Family, developed, motion, seconds, drives and hidden, for the file of results."""

    def seal(self) -> Sealed:
        """Make the recording and return it with its truth."""


@dataclass(frozen=True)
class OfPlant:
    """A question about a true plant."""

    case: Case

    @property
    def key(self) -> str:
        """Key in a file of results."""
        return f'truths|{self.case.key}'

    @cached_property
    def about(self) -> Mapping[str, object]:
        """Properties of the question for the file of results, as of `Question.about`."""
        case = self.case
        return {
            'family': case.family,
            'developed': FAMILIES[case.family].developed,
            'motion': case.motion,
            'seconds': case.seconds,
            'drives': case.drives,
            'hidden': list(case.hidden),
        }

    def seal(self) -> Sealed:
        """Make the recording and return it with its truth."""
        found = record(self.case)
        drives = found.plant.drives
        off = {
            'torque_scale': max(abs(drive.torque_scale - 1) for drive in drives),
            'power_gain': max(abs(drive.meter_gain - 1) for drive in drives),
            'current_offset': max(abs(drive.meter_offset) for drive in drives),
            'torque_bias': max(abs(drive.torque_bias) / drive.torque_limit for drive in drives),
        }
        off['torque_scale'] += max(drive.saturation / 8 for drive in drives)
        wrong = {name for name, size in off.items() if size >= NAMED_FROM}
        if max(drive.saturation for drive in drives) >= NAMED_FROM:
            wrong.add('motor_saturation')
        if any(drive.magnet_temperature for drive in drives):
            wrong.add('magnet_heating')
        at = 'k' if 'winding_heating' in found.known else 'k_warm'
        coefficients = {
            name: {**truth, 'k': truth[at]} for name, truth in found.coefficients.items()
        }
        watts, apart = (hidden_watts(self.case, apart=one) for one in (False, True))
        shown = SPIKE * float(np.sqrt(np.mean(np.square(found.power))))  # less counts as absent
        lacks = {
            name for name in found.missing if name in self.case.hidden or watts[name] >= shown
        }
        rate = found.plant.sampling.meter_rate
        window = energy_window([rate]) if rate < LEAST_UPDATES else 0.0
        missing = frozenset(lacks | wrong)
        return Sealed(found.data, found.known, missing, coefficients, watts, apart, window=window)


@dataclass(frozen=True)
class OfRobot:
    """A question about a walk of the shipped robot, whose model may lack one effect (`hidden`)."""

    seconds: float
    seed: int
    hidden: tuple[str, ...] = ()
    real: bool = False  # with torque loop, battery and what else real drives have

    @property
    def key(self) -> str:
        """Key in a file of results."""
        name = 'real robot' if self.real else 'robot'
        return f'{name}|{self.seconds:g}|{"+".join(self.hidden)}|{self.seed}'

    @property
    def about(self) -> Mapping[str, object]:
        """Properties of the question for the file of results, as of `Question.about`."""
        return {
            'family': 'anymal_c, real drives' if self.real else 'anymal_c',
            'developed': not self.real,
            'motion': 'walk',
            'seconds': self.seconds,
            'drives': len(NAMES),
            'hidden': list(self.hidden),
        }

    def seal(self) -> Sealed:
        """Simulate the robot's walk and measure three of its drives."""
        plant = RobotPlant.load('anymal_c').unit(self.seed + 1)
        if self.real:
            plant = plant.with_effects(**dict.fromkeys(REAL, True))
        run = walking_run(plant, duration=self.seconds, seed=self.seed, drives=NAMES)
        data = align(simulate_recording(run), rate=400.0, smooth=False, drives=NAMES)
        exists = {name for name, effect in plant.effects if effect.enabled} - {*REAL}
        known = ('shaft', *sorted(exists - set(self.hidden)))
        parameters = plant.resolve(NAMES)
        coefficients = {
            name: _robot_coefficients({key: float(value[i]) for key, value in parameters.items()})
            for i, name in enumerate(NAMES)
        }
        return Sealed(data, known, frozenset(self.hidden), coefficients)


def _robot_coefficients(p: Mapping[str, float]) -> dict[str, float]:
    at_one = p['coulomb'] + p['stribeck'] / (1 + (1 / p['stribeck_velocity']) ** 2) ** 2
    return {
        'k': (p['resistance'] + p['device_resistance']) / p['torque_constant'] ** 2,
        'inertia': p['rotor_inertia'],
        'idle': p['idle_power'],
        'spring': 1 / p['spring_stiffness'],
        'friction_at_1': at_one + p['viscous'] / (1 + 1 / p['shear_velocity']),
        'load_friction': p['load_friction'],
    }


def robot_questions(count: int, *, seed: int = 0, nulls: bool = False) -> list[OfRobot]:
    """Draw walks of 30 to 300 s, every other one of real drives.

    Of two in five an effect that exists is left out of the model.
    """
    out = []
    for index in range(count):
        random = np.random.default_rng([seed, index, 17])
        seconds = float(random.choice([30.0, 60.0, 90.0, 150.0, 300.0]))
        left_out = not nulls and random.random() < 0.4
        effect = str(random.choice(['copper_loss', 'load_friction', 'rotor_inertia', 'spring']))
        hidden = (effect,) if left_out else ()
        out.append(OfRobot(seconds, seed * 100_000 + index, hidden, real=index % 2 == 1))
    return out


def plant_questions(
    families: Sequence[str],
    count: int,
    *,
    seed: int = 0,
    seconds: float | None = None,
    drives: int | None = None,
    nulls: bool = False,
) -> list[OfPlant]:
    """Draw `count` questions of each family, with random motions, drives and effects.

    Two in five hide nothing, two in five one effect of the catalogue, one in ten two of them. One
    in ten hide an effect that no catalogue has, half of these beside one that it has.
    """
    out = []
    for name in families:
        family = FAMILIES[name]
        for index in range(count):
            random = np.random.default_rng([seed, index, *name.encode()])
            motion = str(random.choice(family.motions))
            length = float(random.choice(LENGTHS, p=_SHARES))
            size = drives or int(random.choice([1, 3, 12], p=[0.3, 0.6, 0.1]))
            hidden = () if nulls else _hidden(random, name, size)
            if size >= _LONG_BUS[0]:
                length = min(length, _LONG_BUS[1])
            case = Case(
                family=name,
                motion=motion,
                seconds=length if seconds is None else seconds,
                drives=size,
                seed=seed * 100_000 + index,
                hidden=hidden,
                strength=float(random.choice([0.5, 1.0, 2.0])),
            )
            out.append(OfPlant(case))
    return out


def _hidden(random: np.random.Generator, name: str, drives: int) -> tuple[str, ...]:
    family = FAMILIES[name]
    may = {'copper_loss', 'idle', *family.always, *family.often, 'load_friction', 'cogging'}
    may -= {'spring'} if 'spring' not in family.always else set()
    if family.change(np.random.default_rng(0)).get('torque_at_motor'):
        may -= set(IN_MOTOR_TORQUE)
    one, two = (str(effect) for effect in random.choice(sorted(may), 2, replace=False))
    strangers = [one for one in UNMODELLED if drives > 1 or one != 'cross_talk']
    stranger = str(random.choice(strangers))
    kind = random.random()
    if kind < 0.4:
        return ()
    if kind < 0.8:
        return (one,)
    if kind < 0.9:
        return (one, two)
    return (stranger,) if kind < 0.95 else (stranger, one)
