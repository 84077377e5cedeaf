"""Configuration of a training run, read from YAML.

Defaults are the rewards, noise and PPO of legged_gym's flat ANYmal, which the paper trains [14],
with MuJoCo in place of Isaac Gym; `configs` has what works with few robots.
"""

from collections.abc import Mapping
from dataclasses import asdict, field, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final, Literal

from policy_runner.policies.gait_phase import CADENCE_ADAPTATION, COMMAND_RATE_LIMIT
from policy_runner.policies.observations import CLOCKED, STANDARD, Observation
from policy_runner.policies.trot_gait import TROTS
from wattwalk_core.errors import InputError
from wattwalk_core.files import write_whole
from wattwalk_core.schema import Length, Quantity, parse, schema
from wattwalk_core.yaml_file import dump_yaml, read_yaml, shipped_file

CONFIGS: Final = Path(__file__).parent / 'configs'
GAITS: Final = Path(__file__).parent / 'gaits'


def gait_path(source: str) -> Path:
    """Return the file of a gait, or where the shipped one of that name would be."""
    shipped = GAITS / f'{source}.yaml'
    return shipped if shipped.parent == GAITS and shipped.exists() else Path(source)


def gait_names() -> tuple[str, ...]:
    """Return the names of the gaits that a training may imitate."""
    return (*TROTS, *sorted(path.stem for path in GAITS.glob('*.yaml')))


def _check_ramp(name: str, begin: float, end: float) -> None:
    if end < begin:
        raise InputError(f'{name}_to is {end!r}; it must be at least {name}_from = {begin!r}')


def _ramp(steps: float, begin: float, end: float) -> float:
    """Return the share 0..1 of a linear ramp between two numbers of policy steps."""
    return 1.0 if steps >= end else max((steps - begin) / (end - begin), 0.0)


@schema
class TrialConfig:
    """Robots of a trial on the tasks, and prices of what is not power, see `task_trial.py`."""

    calm: Annotated[int, Quantity(1, 64, '', 'robots that walk a task undisturbed')] = 2
    pushed: Annotated[int, Quantity(0, 64, '', 'robots that are pushed in a task')] = 4
    seconds: Annotated[float, Quantity(5.0, 60.0, 's', 'of walking')] = 9.0
    push: Annotated[float, Quantity(0.0, 3.0, 'm/s', 'along x and y, ±')] = 1.4
    push_period: Annotated[float, Quantity(1.0, 60.0, 's')] = 2.5
    speed_price: Annotated[float, Quantity(0.0, 1e5, 'W per m/s')] = 1500.0
    yaw_price: Annotated[float, Quantity(0.0, 1e5, 'W per rad/s')] = 600.0
    fall_price: Annotated[float, Quantity(0.0, 1e5, 'W', 'if all fall')] = 500.0


@schema
class PhysicsConfig:
    """World and time steps of the environments."""

    environments: Annotated[int, Quantity(1, 65536, '', 'robots that learn together')] = 512
    threads: Annotated[int, Quantity(0, 256, '', 'of the simulation; 0: one per core')] = 0
    timestep: Annotated[float, Quantity(0.0005, 0.01, 's', 'of the rigid bodies')] = 0.005
    decimation: Annotated[int, Quantity(1, 40, '', 'time steps per policy step')] = 4
    episode: Annotated[float, Quantity(1.0, 601.0, 's', 'longest')] = 20.0
    noise: Annotated[float, Quantity(0.0, 0.2, 'm', 'of the ground, ±')] = 0.02
    slope: Annotated[float, Quantity(0.0, 0.2, '', 'of the ground, steepest')] = 0.02
    extent: Annotated[float, Quantity(24.0, 200.0, 'm', 'edge of the ground')] = 80.0
    plant: str = 'anymal_c'  # of the simulated drives
    contacts: Literal['all', 'feet_and_base'] = 'all'  # what may touch the ground


@schema
class RandomConfig:
    """Differences between robots, and disturbances."""

    friction_low: Annotated[float, Quantity(0.05, 3.0, '', 'of the ground')] = 0.5
    friction_high: Annotated[float, Quantity(0.05, 3.0, '', 'of the ground')] = 1.25
    payload: Annotated[float, Quantity(0.0, 10.0, 'kg', 'of the base, ±')] = 5.0
    push: Annotated[float, Quantity(0.0, 5.0, 'm/s', 'along x and y, ±')] = 1.0
    push_period: Annotated[float, Quantity(0.1, 600.0, 's')] = 15.0
    push_first: Annotated[float, Quantity(0.0, 1.0, '', 'share of the push at first')] = 1.0
    push_from: Annotated[float, Quantity(0.0, 1e12, '', 'policy steps with that')] = 0.0
    push_to: Annotated[float, Quantity(0.0, 1e12, '', 'policy steps to the full push')] = 0.0
    delay: Annotated[float, Quantity(0.0, 0.02, 's', 'of targets, plant’s ± this')] = 0.015
    stiffness: Annotated[float, Quantity(0.0, 0.5, '', 'spread of both gains')] = 0.1
    drive_friction: Annotated[float, Quantity(0.0, 0.9, '', 'spread')] = 0.3
    inertia: Annotated[float, Quantity(0.0, 0.9, '', 'spread of the rotors')] = 0.2
    torque_loop: Annotated[float, Quantity(0.0, 0.9, '', 'spread of the bandwidths')] = 0.0
    output: Annotated[float, Quantity(0.0, 0.9, '', 'spread of what sits behind springs')] = 0.0
    pose: Annotated[float, Quantity(0.0, 0.9, '', 'spread of initial joint angles')] = 0.5
    velocity: Annotated[float, Quantity(0.0, 2.0, 'm/s, rad/s', 'initial, ±')] = 0.5
    resting: Annotated[float, Quantity(0.0, 1.0, '', 'share that starts standing')] = 0.2

    def __post_init__(self) -> None:
        if self.friction_low > self.friction_high:
            raise InputError(
                f'friction_low is {self.friction_low!r}; '
                f'it must not exceed friction_high = {self.friction_high!r}'
            )
        _check_ramp('push', self.push_from, self.push_to)

    def push_share(self, steps: float) -> float:
        """Return the share of the push after a number of policy steps."""
        return self.push_first + (1.0 - self.push_first) * _ramp(
            steps, self.push_from, self.push_to
        )


@schema
class CommandConfig:
    """Velocity commands of training."""

    forward: Annotated[float, Quantity(0.0, 2.0, 'm/s', '±')] = 1.0
    lateral: Annotated[float, Quantity(0.0, 2.0, 'm/s', '±')] = 0.6
    yaw: Annotated[float, Quantity(0.0, 3.0, 'rad/s', '±')] = 1.0
    period: Annotated[float, Quantity(0.1, 600.0, 's', 'between commands')] = 4.0
    standing: Annotated[float, Quantity(0.0, 1.0, '', 'share of commands to stand')] = 0.1
    single: Annotated[float, Quantity(0.0, 1.0, '', 'share of commands along one axis')] = 0.3
    ramp_from: Annotated[float, Quantity(0.0, 1.0, '', 'initial share of the range')] = 0.5
    ramp_steps: Annotated[float, Quantity(0.0, 1e12, '', 'policy steps to full range')] = 5e6


@schema
class NoiseConfig:
    """Uniform noise on observations before scaling, ±."""

    least: Annotated[float, Quantity(0.0, 1.0, '', 'share of it, quietest robot')] = 0.0
    clean: Annotated[float, Quantity(0.0, 1.0, '', 'share of robots without noise')] = 0.25
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

    model: str = ''  # ppn:FILE_OR_RUN, a file of effects, plant, see power_term.py; empty: none
    weight: Annotated[float, Quantity(0.0, 1.0, '1/W', 'per second; the paper: 4e-4')] = 0.0
    ramp_from: Annotated[float, Quantity(0.0, 1e12, '', 'policy steps of weight 0')] = 0.0
    ramp_to: Annotated[float, Quantity(0.0, 1e12, '', 'policy steps to full weight')] = 0.0
    masked: Annotated[int, Quantity(0, 1000, '', 'policy steps without it after a start')] = 5
    multiplier_rate: Annotated[float, Quantity(0.0, 1.0, '', 'a trial; 0: fixed weight')] = 0.0
    most_multiplier: Annotated[float, Quantity(1.0, 1000.0, '', 'of the weight')] = 10.0

    def __post_init__(self) -> None:
        if self.weight > 0.0 and not self.model:
            raise InputError(f'weight is {self.weight!r} without power.model; name a model')
        _check_ramp('ramp', self.ramp_from, self.ramp_to)

    def weight_at(self, steps: float) -> float:
        """Return the weight after a number of policy steps, 1/W."""
        return self.weight * _ramp(steps, self.ramp_from, self.ramp_to)


@schema
class PpoConfig:
    """Settings of PPO, by default those of legged_gym."""

    RENAMED: ClassVar = {
        'most_advantage': 'advantage_clip',
        'hold_rate': 'anchor_rate',
        'hold_within': 'anchor_tolerance',
    }

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
    std_end: Annotated[float, Quantity(0.0, 10.0, '', 'at the last step; 0: as std')] = 0.0
    learn_std: bool = True  # false: constant; with `calm` a learned one shrinks
    calm: Annotated[float, Quantity(0.0, 0.9, '', 'share of time without exploration')] = 0.0
    advantage_clip: Annotated[float, Quantity(1.0, 100.0, '', 'standard deviations')] = 2.0
    anchor_rate: Annotated[float, Quantity(0.0, 1e-2, '', 'see reference_policy.py')] = 0.0
    anchor_tolerance: Annotated[float, Quantity(0.0, 1.0, '', 'units of action')] = 0.05
    anchor_urgency: Annotated[float, Quantity(0.0, 1.0, '', 'least, of rows that count')] = 0.0
    mirror: bool = False  # adds mirror images of steps; spoils a gait at a small std
    hidden: Annotated[tuple[Annotated[int, Quantity(1, 4096)], ...], Length(1)] = (128, 64, 32)

    def __post_init__(self) -> None:
        if self.std_end and self.learn_std:
            raise InputError(f'std_end is {self.std_end!r} with learn_std; set learn_std: false')

    def std_at(self, share: float) -> float:
        """Return the exploration after a share of the run, units of action; even in ratios."""
        last = self.std_end or self.std
        return float(self.std * (last / self.std) ** min(max(share, 0.0), 1.0))


@schema
class SelectionConfig:
    """Trials during training, by which a policy and the multiplier of the power term are chosen.

    The policy that is exported is the one whose trial cost least, see `task_trial.py`. The
    multiplier rises while a trial keeps the limits, and falls back twice as fast where one does
    not: power is then as low as tracking and falls allow.
    """

    every: Annotated[int, Quantity(0, 10**6, 'iterations', 'between trials; 0: none')] = 0
    speed_error: Annotated[float, Quantity(0.0, 1.0, 'm/s', 'limit, worst task')] = 0.1
    yaw_error: Annotated[float, Quantity(0.0, 1.0, 'rad/s', 'limit, worst task')] = 0.15
    falls: Annotated[float, Quantity(0.0, 1.0, '', 'limit, share of pushed robots')] = 0.05
    trial: TrialConfig = field(default_factory=TrialConfig)


@schema
class CurriculumConfig:
    """Ramp of all rewards but tracking, so that walking is worth while early."""

    begin: Annotated[float, Quantity(0.0, 1.0, '', 'initial share')] = 1.0
    steps: Annotated[float, Quantity(0.0, 1e12, '', 'policy steps to full size')] = 0.0

    def share(self, steps: float) -> float:
        """Return the share after a number of policy steps."""
        if steps >= self.steps:
            return 1.0
        return self.begin + (1.0 - self.begin) * steps / self.steps


@schema
class ImitationConfig:
    """Imitation of a scripted gait before PPO, see `imitation.py`."""

    gait: str = ''  # a name or a file; empty: none
    robots: Annotated[int, Quantity(2, 4096, '', 'led by the gait')] = 128
    seconds: Annotated[float, Quantity(2.0, 600.0, 's', 'of walking in each round')] = 8.0
    epochs: Annotated[int, Quantity(2, 1000, '', 'of learning after each round')] = 24
    critic_rounds: Annotated[int, Quantity(0, 1000, '', 'of the critic alone')] = 15
    rounds: Annotated[int, Quantity(1, 50, '', 'of demonstrations (DAgger)')] = 3

    def __post_init__(self) -> None:
        if self.gait and self.gait not in TROTS and not gait_path(self.gait).exists():
            raise InputError(
                f'gait is {self.gait!r}; it must be one of {", ".join(gait_names())}, or a file'
            )


@schema
class TrainingConfig:
    """Configuration of a training run; cadence adaptation and rate limit as in observations."""

    RENAMED: ClassVar = {'hurry': 'cadence_adaptation', 'command_slew': 'command_rate_limit'}

    name: str = 'baseline'
    seed: Annotated[int, Quantity(0, 2**31 - 1)] = 1
    steps: Annotated[float, Quantity(1.0, 1e12, '', 'policy steps of all environments')] = 20e6
    action_scale: Annotated[float, Quantity(0.01, 5.0, 'rad', 'per unit of action')] = 0.5
    clock: bool = True  # the policy is given its gait phase
    stride_frequency: Annotated[float, Quantity(0.8, 3.0, 'Hz')] = CLOCKED.stride_frequency
    frequency_per_speed: Annotated[float, Quantity(0.0, 3.0, 'Hz·s/m', 'by command')] = 0.0
    cadence_adaptation: tuple[float, ...] = CADENCE_ADAPTATION
    command_rate_limit: tuple[Annotated[float, Quantity(0.1, 100.0)], ...] = COMMAND_RATE_LIMIT
    checkpoint_every: Annotated[int, Quantity(1, 10**6, 'iterations')] = 50
    physics: PhysicsConfig = field(default_factory=PhysicsConfig)
    random: RandomConfig = field(default_factory=RandomConfig)
    commands: CommandConfig = field(default_factory=CommandConfig)
    noise: NoiseConfig = field(default_factory=NoiseConfig)
    rewards: RewardConfig = field(default_factory=RewardConfig)
    power: PowerConfig = field(default_factory=PowerConfig)
    curriculum: CurriculumConfig = field(default_factory=CurriculumConfig)
    imitation: ImitationConfig = field(default_factory=ImitationConfig)
    ppo: PpoConfig = field(default_factory=PpoConfig)
    selection: SelectionConfig = field(default_factory=SelectionConfig)

    def __post_init__(self) -> None:
        self.observation  # noqa: B018  # checks its values
        if self.ppo.anchor_rate > 0.0 and not self.cadence_adaptation:
            raise InputError(
                f'ppo.anchor_rate is {self.ppo.anchor_rate!r} without cadence_adaptation; give '
                'that, or 0'
            )
        if not self.clock and self.cadence_adaptation:
            raise InputError(
                f'cadence_adaptation is {list(self.cadence_adaptation)} with clock: false; a '
                'policy without a gait phase has no cadence to adapt: give []'
            )

    @property
    def observation(self) -> Observation:
        """Observation of the trained policies."""
        return replace(
            CLOCKED if self.clock else STANDARD,
            stride_frequency=self.stride_frequency,
            frequency_per_speed=self.frequency_per_speed,
            cadence_adaptation=self.cadence_adaptation,
            command_rate_limit=self.command_rate_limit,
        )

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
        """Return the config with values by dotted name: `{'power.weight': 8e-4, 'seed': 2}`."""
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
        """Return keys and values as a file holds them."""
        content: dict[str, Any] = asdict(self)  # type: ignore[call-overload]
        return content

    def save(self, path: Path) -> None:
        """Write a file that `load` reads back as an equal config."""
        write_whole(path, dump_yaml(self.content()))
