"""Configuration of a training run, read from YAML.

Defaults are legged_gym's flat ANYmal, which the paper trains [14]: its rewards (sigma 0.25, never
below 0), commands, pushes, noise and PPO. Its simulator averages the friction of foot (0 to 1.5)
and ground (1): 0.5 to 1.25 here. What differs: MuJoCo; the drives of `anymal_c_published`, spread
about as published, in place of a network of ANYmal's; 512 robots in place of 4096 and 80 M steps
in place of 246 M; a fifth of the robots start at rest; the critic sees true states and feet, and
learns at a rate of its own; air time is paid, and commands are zeroed, by all three of their
parts; torque is that of four time steps; a command or a push ends an episode as a time-out does.
"""

from collections.abc import Mapping
from dataclasses import asdict, field, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final

from policy_runner.policies.observations import STANDARD, Observation
from wattwalk_core.errors import InputError
from wattwalk_core.files import write_whole
from wattwalk_core.schema import Length, Quantity, parse, schema
from wattwalk_core.yaml_file import dump_yaml, read_yaml, shipped_file

CONFIGS: Final = Path(__file__).parent / 'configs'


@schema
class PhysicsConfig:
    """World and time steps of the environments."""

    environments: Annotated[int, Quantity(1, 65536, '', 'robots that learn together')] = 512
    threads: Annotated[int, Quantity(0, 256, '', 'of the simulation; 0: one per core')] = 0
    timestep: Annotated[float, Quantity(0.0005, 0.01, 's', 'of the rigid bodies')] = 0.005
    decimation: Annotated[int, Quantity(1, 40, '', 'time steps per policy step')] = 4
    episode: Annotated[float, Quantity(1.0, 601.0, 's', 'longest')] = 20.0
    noise: Annotated[float, Quantity(0.0, 0.2, 'm', 'of the ground, ±')] = 0.0
    slope: Annotated[float, Quantity(0.0, 0.2, '', 'of the ground, steepest')] = 0.0
    extent: Annotated[float, Quantity(24.0, 200.0, 'm', 'edge of the ground')] = 80.0
    plant: str = 'anymal_c_published'  # of the simulated drives


@schema
class RandomConfig:
    """Differences between robots, and disturbances."""

    friction_low: Annotated[float, Quantity(0.05, 3.0, '', 'of the ground')] = 0.5
    friction_high: Annotated[float, Quantity(0.05, 3.0, '', 'of the ground')] = 1.25
    payload: Annotated[float, Quantity(0.0, 10.0, 'kg', 'of the base, ±')] = 5.0
    push: Annotated[float, Quantity(0.0, 5.0, 'm/s', 'along x and y, ±')] = 1.0
    push_period: Annotated[float, Quantity(0.1, 600.0, 's')] = 15.0
    delay: Annotated[float, Quantity(0.0, 0.02, 's', 'of targets, plant’s ± this')] = 0.0025
    stiffness: Annotated[float, Quantity(0.0, 0.5, '', 'spread of both gains')] = 0.0
    drive_friction: Annotated[float, Quantity(0.0, 0.9, '', 'spread')] = 0.12
    inertia: Annotated[float, Quantity(0.0, 0.9, '', 'spread of the rotors')] = 0.35
    torque_loop: Annotated[float, Quantity(0.0, 0.9, '', 'spread of the bandwidths')] = 0.3
    output: Annotated[float, Quantity(0.0, 0.9, '', 'spread of what sits behind springs')] = 0.12
    pose: Annotated[float, Quantity(0.0, 0.9, '', 'spread of initial joint angles')] = 0.5
    velocity: Annotated[float, Quantity(0.0, 2.0, 'm/s, rad/s', 'initial, ±')] = 0.5
    resting: Annotated[float, Quantity(0.0, 1.0, '', 'share that starts standing')] = 0.2

    def __post_init__(self) -> None:
        if self.friction_low > self.friction_high:
            raise InputError(
                f'friction_low is {self.friction_low!r}; '
                f'it must not exceed friction_high = {self.friction_high!r}'
            )


@schema
class CommandConfig:
    """Velocity commands of training."""

    forward: Annotated[float, Quantity(0.0, 2.0, 'm/s', '±')] = 1.0
    lateral: Annotated[float, Quantity(0.0, 2.0, 'm/s', '±')] = 1.0
    yaw: Annotated[float, Quantity(0.0, 3.0, 'rad/s', '±')] = 1.5
    period: Annotated[float, Quantity(0.1, 600.0, 's', 'between commands')] = 4.0
    standing: Annotated[float, Quantity(0.0, 1.0, '', 'share of commands to stand')] = 0.0
    single: Annotated[float, Quantity(0.0, 1.0, '', 'share of commands along one axis')] = 0.0


@schema
class NoiseConfig:
    """Uniform noise on observations before scaling, ±."""

    base_velocity: Annotated[float, Quantity(0.0, 2.0, 'm/s')] = 0.1
    angular_velocity: Annotated[float, Quantity(0.0, 5.0, 'rad/s')] = 0.2
    gravity: Annotated[float, Quantity(0.0, 1.0)] = 0.05
    joint_position: Annotated[float, Quantity(0.0, 1.0, 'rad')] = 0.01
    joint_velocity: Annotated[float, Quantity(0.0, 10.0, 'rad/s')] = 1.5


@schema
class RewardConfig:
    """Weights per second of the rewards in `rewards.py`, by the names of legged_gym."""

    RENAMED: ClassVar = {
        'velocity': 'tracking_lin_vel',
        'yaw': 'tracking_ang_vel',
        'sigma': 'tracking_sigma',
        'vertical': 'lin_vel_z',
        'rolling': 'ang_vel_xy',
        'torque': 'torques',
        'acceleration': 'dof_acc',
        'air_time': 'feet_air_time',
        'standing': 'stand_still',
        'fall': 'termination',
    }

    tracking_lin_vel: Annotated[float, Quantity(0.0, 100.0)] = 1.0
    tracking_ang_vel: Annotated[float, Quantity(0.0, 100.0)] = 0.5
    tracking_sigma: Annotated[float, Quantity(0.01, 10.0, '(m/s)², (rad/s)²')] = 0.25
    lin_vel_z: Annotated[float, Quantity(-100.0, 0.0, 's²/m²')] = -2.0
    ang_vel_xy: Annotated[float, Quantity(-100.0, 0.0, 's²/rad²')] = -0.05
    orientation: Annotated[float, Quantity(-100.0, 0.0)] = -5.0
    torques: Annotated[float, Quantity(-1.0, 0.0, '1/(N·m)²')] = -2.5e-5
    dof_acc: Annotated[float, Quantity(-1.0, 0.0, 's⁴/rad²')] = -2.5e-7
    feet_air_time: Annotated[float, Quantity(0.0, 100.0, '1/s')] = 2.0
    air_time_target: Annotated[float, Quantity(0.0, 2.0, 's')] = 0.5
    collision: Annotated[float, Quantity(-100.0, 0.0, '', 'each thigh or shank')] = -1.0
    action_rate: Annotated[float, Quantity(-10.0, 0.0)] = -0.01
    stand_still: Annotated[float, Quantity(-100.0, 0.0, '1/rad')] = 0.0
    termination: Annotated[float, Quantity(-1000.0, 0.0, '', 'once per fall')] = 0.0
    only_positive: bool = True


@schema
class PowerConfig:
    """Power term of Section II-A: weight × predicted power of all drives."""

    model: str = ''  # ppn:FILE_OR_RUN, a file of effects, plant, see rewards.py; empty: none
    weight: Annotated[float, Quantity(0.0, 1.0, '1/W', 'per second; the paper: 4e-4')] = 0.0
    ramp_from: Annotated[float, Quantity(0.0, 1e12, '', 'policy steps of weight 0')] = 0.0
    ramp_to: Annotated[float, Quantity(0.0, 1e12, '', 'policy steps to full weight')] = 0.0
    masked: Annotated[int, Quantity(0, 1000, '', 'policy steps without it after a start')] = 5

    def __post_init__(self) -> None:
        if self.weight > 0.0 and not self.model:
            raise InputError(f'weight is {self.weight!r} without power.model; name a model')
        if self.ramp_to < self.ramp_from:
            raise InputError(
                f'ramp_to is {self.ramp_to!r}; it must be at least ramp_from = {self.ramp_from!r}'
            )

    def weight_at(self, steps: float) -> float:
        """Return the weight after a number of policy steps, 1/W."""
        if steps >= self.ramp_to:
            return self.weight
        if steps <= self.ramp_from:
            return 0.0
        return self.weight * (steps - self.ramp_from) / (self.ramp_to - self.ramp_from)


@schema
class PpoConfig:
    """Settings of PPO, by default those of legged_gym."""

    RENAMED: ClassVar = {'most_advantage': 'advantage_clip'}

    steps: Annotated[int, Quantity(1, 1000, '', 'per environment and iteration')] = 24
    epochs: Annotated[int, Quantity(1, 100)] = 5
    minibatches: Annotated[int, Quantity(1, 1000)] = 4
    learning_rate: Annotated[float, Quantity(1e-7, 1.0, '', 'initial')] = 1e-3
    desired_kl: Annotated[float, Quantity(1e-5, 1.0, '', 'adapts the learning rate')] = 0.01
    clip: Annotated[float, Quantity(0.01, 1.0)] = 0.2
    gamma: Annotated[float, Quantity(0.5, 1.0)] = 0.99
    lambda_: Annotated[float, Quantity(0.0, 1.0)] = 0.95
    entropy: Annotated[float, Quantity(0.0, 1.0)] = 0.01
    gradient_norm: Annotated[float, Quantity(1e-3, 1e3)] = 1.0
    std: Annotated[float, Quantity(0.01, 10.0, '', 'of actions, initial')] = 1.0
    advantage_clip: Annotated[float, Quantity(1.0, 100.0, '', 'standard deviations')] = 100.0
    hidden: Annotated[tuple[Annotated[int, Quantity(1, 4096)], ...], Length(1)] = (128, 64, 32)


@schema
class TrainingConfig:
    """Configuration of a training run."""

    RENAMED: ClassVar = {'command_slew': 'command_rate_limit'}

    name: str = 'baseline'
    seed: Annotated[int, Quantity(0, 2**31 - 1)] = 1
    steps: Annotated[float, Quantity(1.0, 1e12, '', 'policy steps of all environments')] = 80e6
    action_scale: Annotated[float, Quantity(0.01, 5.0, 'rad', 'per unit of action')] = 0.5
    command_rate_limit: tuple[Annotated[float, Quantity(0.1, 100.0)], ...] = ()
    checkpoint_every: Annotated[int, Quantity(1, 10**6, 'iterations')] = 50
    physics: PhysicsConfig = field(default_factory=PhysicsConfig)
    random: RandomConfig = field(default_factory=RandomConfig)
    commands: CommandConfig = field(default_factory=CommandConfig)
    noise: NoiseConfig = field(default_factory=NoiseConfig)
    rewards: RewardConfig = field(default_factory=RewardConfig)
    power: PowerConfig = field(default_factory=PowerConfig)
    ppo: PpoConfig = field(default_factory=PpoConfig)

    def __post_init__(self) -> None:
        self.observation  # noqa: B018  # checks its values

    @property
    def observation(self) -> Observation:
        """Observation of the trained policies."""
        return replace(STANDARD, command_rate_limit=self.command_rate_limit)

    @property
    def iterations(self) -> int:
        """Rounds of collecting and learning, rounded up."""
        return -(-int(self.steps) // (self.physics.environments * self.ppo.steps))

    @property
    def step_time(self) -> float:
        """Time between two actions, s."""
        return self.physics.timestep * self.physics.decimation

    @classmethod
    def load(cls, source: Path | str) -> 'TrainingConfig':
        """Read a file, or a shipped config by name; InputError of one line for a bad one."""
        path = shipped_file(source, CONFIGS, 'config')
        return parse(cls, read_yaml(path, 'config'), f'config {path}')

    def with_values(self, changes: Mapping[str, Any]) -> 'TrainingConfig':
        """Return the config with values by dotted name (`power.weight`); InputError for others."""
        content = self.content()
        for name, value in changes.items():
            *sections, key = name.split('.')
            place: Any = content
            kind: Any = self
            for section in sections:
                place = place.get(section) if isinstance(place, dict) else None
                kind = getattr(kind, section, None)
            key = getattr(kind, 'RENAMED', {}).get(key, key)
            if not isinstance(place, dict) or isinstance(place.get(key, {}), dict):
                raise InputError(f'a config has no {name!r}')
            place[key] = value
        return parse(type(self), content, 'config')

    def content(self) -> dict[str, Any]:
        """Return keys and values as nested dicts, as a file has them."""
        return asdict(self)  # type: ignore[call-overload, no-any-return]

    def save(self, path: Path) -> None:
        """Write a file that `load` reads back as an equal config."""
        write_whole(path, dump_yaml(self.content()))
