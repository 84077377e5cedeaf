"""Learning environment of walking by velocity command: observations, rewards, resets."""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from policy_runner.policies.observations import Observation
from policy_runner.policies.velocity_commands import CommandRateLimiter
from sim_bridge.plant.parameters import Plant
from wattwalk_core.anymal import DEFAULT_POSE, GRAVITY
from wattwalk_core.arrays import Bools, Floats, Singles

from policy_training.config import CommandConfig, TrainingConfig
from policy_training.environment.power_source import PlantPower, PowerSource
from policy_training.environment.rewards import FootClock, Rewards, RewardState
from policy_training.environment.robots import RobotMotion, Robots

DEAD_ZONE: Final = 0.1  # m/s, rad/s; norm of a velocity command below which it means standing


class VelocityCommands:
    """Random commands of N robots, `values` [N, 3]: vx and vy in m/s, yaw rate in rad/s."""

    def __init__(self, config: CommandConfig, count: int, random: np.random.Generator) -> None:
        self._config = config
        self._random = random
        self._top = np.array([config.forward, config.lateral, config.yaw])
        self.values = np.zeros((count, 3))

    def draw(self, ids: NDArray[np.intp]) -> None:
        """Draw commands of the robots of these indices: along one axis, all axes, or standing."""
        random, count = self._random, len(ids)
        values = random.uniform(-self._top, self._top, (count, 3))
        kind = random.uniform(size=count)
        axis = random.integers(3, size=count)
        alone = kind < self._config.single
        values[alone] *= np.eye(3)[axis[alone]]
        values[kind >= 1.0 - self._config.standing] = 0.0
        values[np.linalg.norm(values, axis=1) < DEAD_ZONE] = 0.0
        self.values[ids] = values


ACTION_CLIP: Final = 100.0
_METERED: Final = 4  # policy steps between looks at the circuits' watts, which cost 3 % of a step


@dataclass(frozen=True)
class StepOutcome:
    """Result of one action of N robots."""

    observation: Singles  # [N, size]
    state: Singles  # [N, size + 11], see `WalkingEnvironment.state`
    reward: Floats  # [N]
    done: Bools  # [N], reset
    timed_out: Bools  # [N], done without a fall
    disturbed: Bools  # [N], not done, with a new command or a push after this step
    log: dict[str, float]  # means over the robots


class WalkingEnvironment:
    """N robots that are rewarded for following velocity commands.

    power: source of the drives' power for the power term, or None. The weight of that term follows
    `steps`, the number of policy steps done so far. observation: that of the policy; the config's
    if None. Observations and tracking rewards are of the rate-limited commands (`limiter`).
    """

    def __init__(
        self,
        config: TrainingConfig,
        *,
        power: PowerSource | None = None,
        observation: Observation | None = None,
    ) -> None:
        self.config = config
        self.observation = observation = observation or config.observation
        self.steps = 0
        seeds = np.random.default_rng(config.seed).spawn(3)
        self._random = seeds[0]
        self.robots = Robots(config.physics, config.random, seeds[1])
        count = self.count = config.physics.environments
        self.commands = VelocityCommands(config.commands, count, seeds[2])
        self.power = power
        plant = Plant.load(config.physics.plant)
        step = config.step_time
        self._meter = PlantPower(plant, count, config.physics.timestep)
        self._metered = 0.0
        self.watts: NDArray[Any] = np.zeros((count, 12), np.float32)
        self._rewards = Rewards(config.rewards, step)
        self._feet = FootClock(count, step, config.rewards.air_time_target)
        self.limiter = CommandRateLimiter(observation.command_rate_limit, count)
        self._last_action = np.zeros((count, 12))
        self._last_velocity = np.zeros((count, 12))
        self.age = np.zeros(count, np.int64)
        self.longest = round(config.physics.episode / step)
        self._new_command = round(config.commands.period / step)
        self._new_push = round(config.random.push_period / step)
        self._noise_level = self._noise_levels().astype(np.float32)
        self.motion: RobotMotion = self._start(np.arange(count))
        self._sense(step)
        self.age[:] = self._random.integers(0, self.longest, count)

    @property
    def walking(self) -> Bools:
        """True where the command, or the limited one that follows it, is to move [N]."""
        # a command that reverses crosses zero only in the limited one, so both count
        both = np.stack([self.limiter.values, self.commands.values])
        return np.asarray((np.linalg.norm(both, axis=2) >= DEAD_ZONE).any(axis=0))

    def observe(self) -> Singles:
        """Return noisy observations [N, size]."""
        return self._clean() + self._sensor_noise

    def state(self) -> Singles:
        """Return the inputs of a critic [N, size + 11].

        The observation without noise, load on each foot in units of half the weight, its time in
        the air, s, and the command before rate limiting, m/s, m/s and rad/s.
        """
        load = self.motion.foot_force / (0.5 * GRAVITY * self.robots.mass[:, None])
        return np.concatenate(
            [self._clean(), load, self._feet.air, self.commands.values], axis=1, dtype=np.float32
        )

    def _clean(self) -> Singles:
        motion = self.motion
        return self.observation.assemble(
            {
                'base_velocity': motion.velocity,
                'angular_velocity': motion.rate,
                'gravity': motion.gravity,
                'command': self.limiter.values,
                'joint_position': motion.position - DEFAULT_POSE,
                'joint_velocity': motion.joint_velocity,
                'last_action': self._last_action,
            }
        )

    def step(self, actions: NDArray[np.floating]) -> StepOutcome:
        """Simulate one policy step; targets are the default pose plus scaled actions [N, 12]."""
        action = np.clip(np.asarray(actions, np.float64), -ACTION_CLIP, ACTION_CLIP)
        motion = self.robots.step(DEFAULT_POSE + self.config.action_scale * action)
        self.age += 1
        state = RewardState(
            motion=motion,
            command=self.limiter.values,
            walking=self.walking,
            action=action,
            last_action=self._last_action,
            acceleration=(motion.joint_velocity - self._last_velocity) / self.config.step_time,
            flight=self._feet.land(motion.foot_force),
            sigma=self.config.rewards.tracking_sigma,
        )
        terms = self._rewards.terms(state)
        if self.power is not None:
            terms['power'] = self._power_term(self.power)
        reward = np.nan_to_num(self._rewards.total(terms), nan=0.0)
        reward += self.config.rewards.termination * motion.fallen
        timed_out = (self.age >= self.longest) & ~motion.fallen
        done = motion.fallen | timed_out
        log = self._log(terms, motion, reward)
        self._last_action = action
        self._last_velocity = motion.joint_velocity
        self.motion = motion
        self.steps += self.count
        disturbed = self._reset_and_disturb(done)
        self._sense(self.config.step_time)
        return StepOutcome(self.observe(), self.state(), reward, done, timed_out, disturbed, log)

    def _sense(self, seconds: float) -> None:
        """Draw sensor noise and advance rate limiters."""
        draw = self._random.random((self.count, self.observation.size), np.float32)
        self._sensor_noise = (2.0 * draw - 1.0) * self._noise_level
        self.limiter.advance(seconds, self.commands.values)

    def _power_term(self, source: PowerSource) -> Floats:
        power = self.config.power
        self.watts = source.drives(self.robots.substeps)
        counted = self.age > power.masked
        weight = power.weight_at(self.steps) * self.config.step_time
        return np.asarray(-weight * self.watts.sum(axis=1) * counted, np.float64)

    def _reset_and_disturb(self, done: Bools) -> Bools:
        if done.any():
            self.motion = self._start(np.flatnonzero(done))
        fresh = (self.age % self._new_command == 0) & ~done
        if fresh.any():
            self.commands.draw(np.flatnonzero(fresh))
        pushed = (self.age % self._new_push == 0) & ~done & bool(self.config.random.push)
        if pushed.any():
            self.push(np.flatnonzero(pushed))
        return np.asarray(fresh | pushed)

    def push(self, ids: NDArray[np.intp]) -> None:
        """Add random horizontal velocities to the robots of these indices."""
        self.robots.push(ids)
        self.motion = self.robots.motion(self.motion.torque)

    def _start(self, ids: NDArray[np.intp]) -> RobotMotion:
        self.robots.start(ids)
        self._feet.start(ids)
        self.commands.draw(ids)
        self.limiter.values[ids] = 0.0
        if self.power is not None:
            self.power.reset(ids)
        self._last_action[ids] = 0.0
        self._last_velocity[ids] = 0.0
        self.age[ids] = 0
        return self.robots.motion()

    def _noise_levels(self) -> Floats:
        noise = self.config.noise
        levels = np.zeros(self.observation.size)
        for name in self.observation.names:
            if name not in ('command', 'last_action'):
                levels[self.observation.part(name)] = getattr(noise, name)
        return np.asarray(levels * np.abs(self.observation.scales()))

    def _log(
        self, terms: dict[str, Floats], motion: RobotMotion, reward: Floats
    ) -> dict[str, float]:
        away = self.limiter.values - np.column_stack([motion.velocity[:, :2], motion.rate[:, 2]])
        means = np.abs(away).mean(axis=0)
        log = {f'term/{name}': float(values.mean()) for name, values in terms.items()}
        log['reward'] = float(reward.mean())
        log['error/velocity'] = float(np.hypot(away[:, 0], away[:, 1]).mean())
        log['error/vx'], log['error/vy'], log['error/yaw'] = means.tolist()
        log['falls'] = float(motion.fallen.mean())
        if self.power is not None:
            log['power/watts'] = float(self.watts.sum(axis=1).mean())
        if self.steps // self.count % _METERED == 0:
            self._metered = float(self._meter.drives(self.robots.substeps).sum(axis=1).mean())
        log['power/drawn'] = self._metered
        return log
