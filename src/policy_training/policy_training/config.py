"""
Everything that a training run is made of, read from YAML.

Defaults are rewards, noise and PPO of legged_gym's flat ANYmal, which the paper trains [14], with
MuJoCo in place of Isaac Gym; what works with few robots is in `configs`.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Final

import yaml
from policy_runner.policies.gait_phase import (
    CADENCE_ADAPTATION,
    COMMAND_RATE_LIMIT,
    check_cadence_adaptation,
)
from policy_runner.policies.observations import CLOCKED
from policy_runner.policies.trot_gait import TROTS
from sim_bridge.plant.config_fields import bounded, check, from_mapping, read_named
from wattwalk_core.errors import InputError
from wattwalk_core.files import write_whole

CONFIGS: Final = Path(__file__).parent / 'configs'


@dataclass(frozen=True)
class PhysicsConfig:
    """The world of one environment, and how finely it is stepped."""

    environments: int = bounded(512, 1, 65536, '', 'robots that learn at the same time')
    threads: int = bounded(0, 0, 256, '', 'of the simulation; 0: one per core')
    timestep: float = bounded(0.005, 0.0005, 0.01, 's', 'of the rigid bodies')
    decimation: int = bounded(4, 1, 40, '', 'time steps per step of the policy')
    episode: float = bounded(20.0, 1.0, 600.0, 's', 'longest')
    noise: float = bounded(0.02, 0.0, 0.2, 'm', 'of the ground, both ways')
    slope: float = bounded(0.02, 0.0, 0.2, '', 'of the ground, steepest')
    extent: float = bounded(80.0, 24.0, 200.0, 'm', 'edge of the ground')
    plant: str = 'anymal_c'  # whose drives are simulated


@dataclass(frozen=True)
class RandomConfig:
    """What differs between environments, and what happens to them."""

    friction_low: float = bounded(0.5, 0.05, 3.0, '', 'of the ground')
    friction_high: float = bounded(1.25, 0.05, 3.0, '', 'of the ground')
    payload: float = bounded(5.0, 0.0, 10.0, 'kg', 'on or off the base, at most')
    push: float = bounded(1.0, 0.0, 5.0, 'm/s', 'along x and y, at most')
    push_period: float = bounded(15.0, 0.1, 600.0, 's', 'between pushes')
    delay: float = bounded(0.015, 0.0, 0.02, 's', 'of a target on its way, at most')
    stiffness: float = bounded(0.1, 0.0, 0.5, '', 'spread of both gains')
    drive_friction: float = bounded(0.3, 0.0, 0.9, '', 'spread')
    inertia: float = bounded(0.2, 0.0, 0.9, '', 'spread of the rotors')
    pose: float = bounded(0.5, 0.0, 0.9, '', 'spread of the joint angles at a start')
    velocity: float = bounded(0.5, 0.0, 2.0, 'm/s, rad/s', 'of the base at a start, at most')
    resting: float = bounded(0.2, 0.0, 1.0, '', 'share of starts at rest in the default pose')

    def __post_init__(self) -> None:
        if self.friction_low > self.friction_high:
            raise InputError(
                f'random.friction_low is {self.friction_low!r}; '
                f'it must not exceed friction_high = {self.friction_high!r}'
            )


@dataclass(frozen=True)
class CommandConfig:
    """Velocity commands during training."""

    forward: float = bounded(1.0, 0.0, 2.0, 'm/s', 'both ways, at most')
    lateral: float = bounded(0.6, 0.0, 2.0, 'm/s', 'both ways, at most')
    yaw: float = bounded(1.0, 0.0, 3.0, 'rad/s', 'both ways, at most')
    period: float = bounded(4.0, 0.1, 600.0, 's', 'between new commands')
    standing: float = bounded(0.1, 0.0, 1.0, '', 'share of commands to stand still')
    single: float = bounded(0.3, 0.0, 1.0, '', 'share of commands along one axis only')
    ramp_from: float = bounded(0.5, 0.0, 1.0, '', 'share of the range at the start')
    ramp_steps: float = bounded(5e6, 0.0, 1e12, '', 'policy steps until the whole range is asked')


@dataclass(frozen=True)
class NoiseConfig:
    """Uniform noise on observations, before scaling, both ways."""

    least: float = bounded(0.0, 0.0, 1.0, '', 'share of it that the quietest robot has')
    clean: float = bounded(0.25, 0.0, 1.0, '', 'share of robots without any')
    base_velocity: float = bounded(0.1, 0.0, 2.0, 'm/s', '')
    angular_velocity: float = bounded(0.2, 0.0, 5.0, 'rad/s', '')
    gravity: float = bounded(0.05, 0.0, 1.0, '', '')
    joint_position: float = bounded(0.01, 0.0, 1.0, 'rad', '')
    joint_velocity: float = bounded(1.5, 0.0, 10.0, 'rad/s', '')


@dataclass(frozen=True)
class RewardConfig:
    """Weights per second; the terms are in `rewards.py`."""

    velocity: float = bounded(1.0, 0.0, 100.0, '', 'tracking of vx and vy')
    yaw: float = bounded(0.5, 0.0, 100.0, '', 'tracking of the yaw rate')
    sigma: float = bounded(0.25, 0.01, 10.0, '(m/s)², (rad/s)²', 'width of both')
    vertical: float = bounded(-2.0, -100.0, 0.0, 's²/m²', '')
    rolling: float = bounded(-0.05, -100.0, 0.0, 's²/rad²', 'roll and pitch rate')
    orientation: float = bounded(-5.0, -100.0, 0.0, '', 'tilt')
    torque: float = bounded(-2.5e-5, -1.0, 0.0, '1/(N·m)²', '')
    acceleration: float = bounded(-2.5e-7, -1.0, 0.0, 's⁴/rad²', 'of the joints')
    air_time: float = bounded(2.0, 0.0, 100.0, '1/s', 'of each step beyond half a second')
    air_time_target: float = bounded(0.5, 0.0, 2.0, 's', '')
    collision: float = bounded(-1.0, -100.0, 0.0, '', 'each thigh or shank on the ground')
    action_rate: float = bounded(-0.01, -10.0, 0.0, '', '')
    standing: float = bounded(0.0, -100.0, 0.0, '1/rad', 'away from the default pose at rest')
    fall: float = bounded(0.0, -1000.0, 0.0, '', 'each fall, once')
    only_positive: bool = True


@dataclass(frozen=True)
class PowerConfig:
    """The power term of Section II-A: weight × predicted power of all drives."""

    model: str = ''  # ppn:FILE_OR_RUN, a file of named effects, a proxy; empty: no such term
    weight: float = bounded(0.0, 0.0, 1.0, '1/W', 'per second; the paper: 4e-4')
    ramp_from: float = bounded(0.0, 0.0, 1e12, '', 'policy steps at which the weight sets in')
    ramp_to: float = bounded(0.0, 0.0, 1e12, '', 'policy steps at which it is full')
    masked: int = bounded(5, 0, 1000, '', 'steps after a start that do not count')

    def __post_init__(self) -> None:
        if self.weight > 0.0 and not self.model:
            raise InputError(f'power.weight is {self.weight!r} without power.model; name a model')
        if self.ramp_to < self.ramp_from:
            raise InputError(
                f'power.ramp_to is {self.ramp_to!r}; it must be at least ramp_from = '
                f'{self.ramp_from!r}'
            )

    def weight_at(self, steps: float) -> float:
        """Weight after a number of policy steps, 1/W."""
        if steps >= self.ramp_to:
            return self.weight
        share = (steps - self.ramp_from) / (self.ramp_to - self.ramp_from)
        return self.weight * max(share, 0.0)


@dataclass(frozen=True)
class PpoConfig:
    """PPO as legged_gym runs it."""

    steps: int = bounded(24, 1, 1000, '', 'of each environment per iteration')
    epochs: int = bounded(5, 1, 100, '', '')
    minibatches: int = bounded(4, 1, 1000, '', '')
    learning_rate: float = bounded(1e-3, 1e-7, 1.0, '', 'at the start')
    desired_kl: float = bounded(0.01, 1e-5, 1.0, '', 'to which the learning rate adapts')
    clip: float = bounded(0.2, 0.01, 1.0, '', '')
    gamma: float = bounded(0.99, 0.5, 1.0, '', '')
    lambda_: float = bounded(0.95, 0.0, 1.0, '', '')
    entropy: float = bounded(0.01, 0.0, 1.0, '', '')
    gradient_norm: float = bounded(1.0, 1e-3, 1e3, '', '')
    std: float = bounded(1.0, 0.01, 10.0, '', 'of the actions at the start')
    learn_std: bool = True  # or keep it; calm spells make it shrink
    calm: float = bounded(0.0, 0.0, 0.9, '', 'share of time that a robot does not explore')
    most_advantage: float = bounded(2.0, 1.0, 100.0, '', 'standard deviations; limits a fall')
    hold_rate: float = bounded(
        0.0, 0.0, 1e-2, '', 'of learning the first gait again where strides hurry; 0: not'
    )
    hold_within: float = bounded(0.05, 0.0, 1.0, '', 'of its actions, which is near enough')
    mirror: bool = False  # learn from each step's mirror image, too; spoils a gait at a small std
    hidden: tuple[int, ...] = (128, 64, 32)

    def __post_init__(self) -> None:
        widths = tuple(self.hidden) if isinstance(self.hidden, list | tuple) else ()
        if not widths or not all(isinstance(n, int) and 1 <= n <= 4096 for n in widths):
            raise InputError(f'ppo.hidden is {self.hidden!r}; it must list widths in 1..4096')
        object.__setattr__(self, 'hidden', widths)


@dataclass(frozen=True)
class CurriculumConfig:
    """Costs come in slowly, so that walking is worth while early."""

    begin: float = bounded(1.0, 0.0, 1.0, '', 'share of them at the start')
    steps: float = bounded(0.0, 0.0, 1e12, '', 'policy steps until they are there in full')

    def share(self, steps: float) -> float:
        """Share after a number of policy steps."""
        if steps >= self.steps:
            return 1.0
        return self.begin + (1.0 - self.begin) * steps / self.steps


@dataclass(frozen=True)
class ImitationConfig:
    """A scripted gait to begin with, see `imitation.py`."""

    gait: str = ''  # a scripted gait, such as trot_even; empty: random networks
    robots: int = bounded(128, 2, 4096, '', 'that are led by the gait')
    seconds: float = bounded(8.0, 2.0, 600.0, 's', 'that they walk in each of three rounds')
    epochs: int = bounded(24, 2, 1000, '', 'of learning after each')
    critic_rounds: int = bounded(15, 0, 1000, '', 'in which the critic learns alone')

    def __post_init__(self) -> None:
        if self.gait and self.gait not in TROTS:
            raise InputError(
                f'imitation.gait is {self.gait!r}; it must be one of {", ".join(TROTS)}'
            )


@dataclass(frozen=True)
class TrainingConfig:
    """A training run; InputError from `load` quotes the value that is wrong and its range."""

    name: str = 'baseline'
    seed: int = bounded(1, 0, 2**31 - 1, '', '')
    steps: float = bounded(20e6, 1.0, 1e12, '', 'policy steps of all environments together')
    action_scale: float = bounded(0.5, 0.01, 5.0, 'rad', 'of one unit of action')
    stride_frequency: float = bounded(
        CLOCKED.stride_frequency, 0.8, 3.0, 'Hz', 'of the clock of the gait'
    )
    hurry: tuple[float, ...] = CADENCE_ADAPTATION  # Hz, m/s, m/s, empty: never
    command_slew: tuple[float, ...] = COMMAND_RATE_LIMIT  # m/s², m/s², rad/s²; empty: at once
    checkpoint_every: int = bounded(50, 1, 10**6, 'iterations', '')
    physics: PhysicsConfig = field(default_factory=PhysicsConfig)
    random: RandomConfig = field(default_factory=RandomConfig)
    commands: CommandConfig = field(default_factory=CommandConfig)
    noise: NoiseConfig = field(default_factory=NoiseConfig)
    rewards: RewardConfig = field(default_factory=RewardConfig)
    power: PowerConfig = field(default_factory=PowerConfig)
    curriculum: CurriculumConfig = field(default_factory=CurriculumConfig)
    imitation: ImitationConfig = field(default_factory=ImitationConfig)
    ppo: PpoConfig = field(default_factory=PpoConfig)

    def __post_init__(self) -> None:
        check(self, self.name)
        for name in ('hurry', 'command_slew'):
            value = getattr(self, name)
            if not isinstance(value, list | tuple) or not all(
                isinstance(number, int | float) for number in value
            ):
                raise InputError(f'{name} is {value!r}; it must be a list of numbers')
            object.__setattr__(self, name, tuple(value))
        check_cadence_adaptation(self.hurry, self.stride_frequency)
        if self.ppo.hold_rate > 0.0 and not self.hurry:
            raise InputError(
                f'ppo.hold_rate is {self.ppo.hold_rate!r} without hurry; give hurry, or 0'
            )
        for name, kind in _SECTIONS.items():
            section = getattr(self, name)
            if not isinstance(section, kind):
                raise InputError(f'{name} is {section!r}; it must be a mapping')
            check(section, name)

    @property
    def iterations(self) -> int:
        """Rounds of collecting and learning, rounded up."""
        return -(-int(self.steps) // (self.physics.environments * self.ppo.steps))

    @property
    def step_time(self) -> float:
        """Between two actions, s."""
        return self.physics.timestep * self.physics.decimation

    @classmethod
    def load(cls, source: Path | str) -> 'TrainingConfig':
        """Read a file, or a shipped config by name; InputError says what is wrong in it."""
        return cls.parse(read_named(source, CONFIGS, 'config'))

    @classmethod
    def parse(cls, values: object) -> 'TrainingConfig':
        """From the mapping in a config file."""
        if not isinstance(values, Mapping):
            raise InputError(f'a config must be a mapping, not {values!r}')
        sections = {
            name: from_mapping(kind, values[name] or {}, name)
            for name, kind in _SECTIONS.items()
            if name in values
        }
        return from_mapping(cls, {**values, **sections}, 'config')

    def with_values(self, changes: Mapping[str, Any]) -> 'TrainingConfig':
        """Some values changed by dotted name: `{'power.weight': 8e-4, 'seed': 2}`."""
        own: dict[str, Any] = {}
        inner: dict[str, dict[str, Any]] = {}
        for name, value in changes.items():
            section, dot, key = name.partition('.')
            kind = _SECTIONS.get(section) if dot else type(self)
            key = key if dot else section
            known = [entry.name for entry in fields(kind)] if kind is not None else []
            if key not in known or (not dot and key in _SECTIONS):
                raise InputError(f'a config has no {name!r}')
            (inner.setdefault(section, {}) if dot else own)[key] = value
        for section, values in inner.items():
            own[section] = replace(getattr(self, section), **values)
        return replace(self, **own)

    def content(self) -> dict[str, Any]:
        """What `parse` reads."""
        content: dict[str, Any] = asdict(self)
        content['ppo']['hidden'] = list(self.ppo.hidden)
        content['hurry'] = list(self.hurry)
        content['command_slew'] = list(self.command_slew)
        return content

    def save(self, path: Path) -> None:
        """Write a file that `load` reads back as an equal config."""
        write_whole(path, yaml.safe_dump(self.content(), sort_keys=False))


_SECTIONS: Final[Mapping[str, type[Any]]] = {
    'physics': PhysicsConfig,
    'random': RandomConfig,
    'commands': CommandConfig,
    'noise': NoiseConfig,
    'rewards': RewardConfig,
    'power': PowerConfig,
    'curriculum': CurriculumConfig,
    'imitation': ImitationConfig,
    'ppo': PpoConfig,
}
