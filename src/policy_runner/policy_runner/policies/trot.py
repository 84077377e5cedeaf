"""Scripted trot: diagonal legs swing in turn; the output is joint position targets.

It stands in for the paper's standard controller in data collection (Section II-A): velocity
commands and disturbances excite the drives, without learning.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf
from typing import Annotated, Final

import numpy as np
from wattwalk_core.anymal import FOOT_RADIUS, FRONT, GRAVITY, LEFT, LIMITS, ROBOT_MASS
from wattwalk_core.arrays import Floats
from wattwalk_core.schema import CheckedFields, Quantity

from policy_runner.policies import kinematics
from policy_runner.policies.inputs import Inputs
from policy_runner.policies.kinematics import LegState, clipped
from policy_runner.policies.velocity_commands import COMMAND_RATE_LIMIT, CommandRateLimiter

_OFFSETS: Final = np.array([0.0, 0.5, 0.5, 0.0])
_SHIFT_WEIGHT: Final = 0.06


@dataclass(frozen=True)
class Feedback(CheckedFields):
    """Feedback gains of the body's tilt, height and velocity; InputError for one out of range.

    foothold: of foot placement by the velocity error. velocity, yaw: of stance feet. yielding:
    share of the velocity error that stance feet give way to. settle: rate at which uneven feet
    return to level. trim: rate at which lasting velocity errors are removed.
    """

    foothold: Annotated[float, Quantity(0.0, 0.4, 's')] = 0.12
    velocity: Annotated[float, Quantity(0.0, inf, 'N·s/m')] = 180.0
    yaw: Annotated[float, Quantity(0.0, inf, 'N·m·s/rad')] = 80.0
    tilt: Annotated[float, Quantity(0.0, inf, 'N·m/rad')] = 600.0
    tilt_rate: Annotated[float, Quantity(0.0, inf, 'N·m·s/rad')] = 70.0
    height: Annotated[float, Quantity(0.0, inf, 'N/m')] = 3000.0
    yielding: Annotated[float, Quantity(0.0, 1.0)] = 0.25
    settle: Annotated[float, Quantity(0.0, inf, '1/s')] = 4.0
    trim: Annotated[float, Quantity(0.0, inf, '1/s')] = 0.5


@dataclass(frozen=True)
class TrotConfig(CheckedFields):
    """Shape of the gait and gains of the drives; InputError for a value out of range.

    frequency: of strides. duty: share of a stride that a foot is on the ground. height: base over
    ground. foot_x, foot_y: feet from the base's centre.
    max_forward, max_lateral, max_yaw: limits of commands. ramp: from the measured pose to
    standing. stiffness: position gain of the drives. damping: their velocity gain and viscous
    gear friction that targets compensate. friction: Coulomb friction that they compensate. Both
    are below the drives' own, since overcompensation makes the joints oscillate.
    """

    frequency: Annotated[float, Quantity(0.8, 3.0, 'Hz')] = 1.9
    duty: Annotated[float, Quantity(0.5, 0.85)] = 0.58
    height: Annotated[float, Quantity(0.40, 0.62, 'm')] = 0.52
    swing_height: Annotated[float, Quantity(0.01, 0.2, 'm')] = 0.07
    foot_x: Annotated[float, Quantity(0.25, 0.5, 'm')] = 0.40
    foot_y: Annotated[float, Quantity(0.12, 0.36, 'm')] = 0.28
    max_forward: Annotated[float, Quantity(0.0, 1.5, 'm/s')] = 0.8
    max_lateral: Annotated[float, Quantity(0.0, 1.0, 'm/s')] = 0.6
    max_yaw: Annotated[float, Quantity(0.0, 2.0, 'rad/s')] = 0.9
    ramp: Annotated[float, Quantity(0.1, 10.0, 's')] = 1.5
    stiffness: Annotated[float, Quantity(20.0, 400.0, 'N·m/rad')] = 80.0
    damping: Annotated[float, Quantity(0.0, 30.0, 'N·m·s/rad')] = 3.5
    friction: Annotated[float, Quantity(0.0, 10.0, 'N·m')] = 1.2
    feedback: Feedback = field(default_factory=Feedback)

    @property
    def footholds(self) -> Floats:
        """Feet of a standing robot in the base's frame, m [4, 3]."""
        depth = np.full(4, FOOT_RADIUS - self.height)
        return np.column_stack([self.foot_x * FRONT, self.foot_y * LEFT, depth])


DEFAULT_TROT: Final = TrotConfig()
TROTS: Final[Mapping[str, TrotConfig]] = {
    'trot': DEFAULT_TROT,
    'trot_slow': TrotConfig(frequency=1.5, duty=0.64, height=0.50),
    'trot_high': TrotConfig(frequency=2.0, height=0.55, swing_height=0.10, foot_y=0.30),
}
"""Gaits by name, which load the drives differently."""


def stance_torque(
    gains: Feedback,
    legs: LegState,
    load: Floats,
    *,
    height: float,
    gravity: Floats,
    spin: Floats,
    velocity_error: Floats,
) -> Floats:
    """Return joint torques of the stance legs, N·m [4, 3].

    Normal forces are the least-squares ones that give weight, height and levelling together;
    horizontal ones are in proportion to them. load: share of the weight that each foot may bear
    [4]. height: commanded, m. gravity: unit vector in the base's frame [3]. spin: rad/s [3].
    velocity_error: commanded minus measured vx, vy, yaw rate [3].
    """
    from policy_runner.policies.leg_steps import stance_steps  # compiled: numba is slow to import

    g, weight = gains, ROBOT_MASS * GRAVITY
    given = [g.height, g.tilt, g.tilt_rate, g.velocity, g.yaw, height, weight, FOOT_RADIUS]
    body = np.array([gravity, spin, velocity_error], np.float64)
    bearing, torque = np.array(load, np.float64), np.empty((4, 3))
    stance_steps(np.array(given), legs.feet, legs.jacobian, bearing, body, torque)
    return torque


class GaitCycle:
    """Gait cycle of a trot: walking or standing, and the phase of each foot."""

    def __init__(self) -> None:
        self.walking = False
        self.stride = 0.0
        """Phase of the first pair of legs, 0..1; the second pair is half a stride ahead."""
        self.phase = np.zeros(4)  # share of the stride since touchdown
        self.swinging = np.zeros(4, bool)
        self.load = np.ones(4)  # share of the weight that a foot may bear, 0..1
        self._settled_time = 0.0
        self._duty = 0.5

    @property
    def swing_progress(self) -> Floats:
        """Completed share of the swing [4], of swinging feet."""
        return (self.phase - self._duty) / (1.0 - self._duty)

    def advance(
        self, dt: float, frequency: float, duty: float, *, requested: bool, settled: bool
    ) -> None:
        """Advance by dt s at a stride frequency, Hz, and a duty.

        requested: a command or a disturbance calls for steps. settled: body and feet are where
        they should be, so that standing is safe. Walking ends with all feet down, after half a
        settled stride.
        """
        self._duty = duty
        if self.walking:
            before, self.stride = self.stride, (self.stride + frequency * dt) % 1.0
            quiet = settled and not requested
            self._settled_time = self._settled_time + dt if quiet else 0.0
            touchdown = self.stride % 0.5 < before % 0.5
            self.walking = not (touchdown and self._settled_time > 0.5 / frequency)
        elif requested:
            self.walking, self.stride, self._settled_time = True, 0.0, 0.0
        load: Floats = np.ones(4)
        self.phase, self.swinging = np.zeros(4), np.zeros(4, bool)
        if self.walking:
            self.phase = (self.stride + _OFFSETS) % 1.0
            self.swinging = self.phase >= duty
            load = clipped(np.minimum(self.phase, duty - self.phase) / _SHIFT_WEIGHT, 0.0, 1.0)
        self.load = self.load + min(1.0, dt / 0.015) * (load - self.load)
        self.load[self.swinging] = 0.0


TARGET_LIMITS: Final = LIMITS + np.array([-0.5, 0.5])
"""Lowest and highest target, rad [12, 2]: joint limits with a margin for torque over stiffness."""

_FARTHEST_STEP: Final = np.array([0.28, 0.16])  # m from the foothold at rest, along x and y
_NEAREST_STEP: Final = -_FARTHEST_STEP
_OUTWARD: Final = np.column_stack([FRONT, LEFT]).ravel()
_TRIM_LIMIT: Final = 0.15  # m/s, rad/s
_FEEDBACK_FILTER: Final = 0.03  # s, time constant on measured velocity and tilt
_RATE_FILTER: Final = 0.01  # s, time constant on the rates of planned joint angles
_LONGEST_STEP: Final = 0.05  # s


class ScriptedTrot:
    """A trot controller from velocity commands to joint targets.

    Feet follow a plan in the base's frame: stance feet move back with the commanded velocity,
    swing feet move to the centre of the next stance, shifted by the velocity error (Raibert).
    Targets are the joint angles of that plan plus torque over stiffness, so that a compliant
    drive carries the weight and overcomes its friction without a steady error. `rate`: Hz at which
    a robot asks for targets; 50 to 400 are possible.
    """

    rate = 200.0

    def __init__(self, config: TrotConfig = DEFAULT_TROT) -> None:
        self.config, self.ramp = config, config.ramp
        self._rest = config.footholds
        self._top = np.array([config.max_forward, config.max_lateral, config.max_yaw])
        self._initial_pose = np.zeros(12)
        self.reset()

    @property
    def walking(self) -> bool:
        """True while walking, False while standing."""
        return self._cycle.walking

    def reset(self) -> None:
        """Reset; the next step ramps in from the measured pose."""
        self._cycle = GaitCycle()
        self._limiter = CommandRateLimiter(COMMAND_RATE_LIMIT)
        self._time: float | None = None
        self._elapsed = 0.0  # s
        self._trim = np.zeros(3)  # m/s, m/s, rad/s
        self._velocity = np.zeros(2)
        self._tilt = np.zeros(2)
        self._places = self._rest.copy()
        self._lifted_at = self._rest.copy()
        self.planned = kinematics.inverse(self._rest)  # rad [4, 3], without the shift for torque
        self._rates = np.zeros((4, 3))
        self._feet = np.zeros((4, 3))

    def take_over(self) -> float:
        """Reset; return the s of the ramp from the present pose to standing."""
        self.reset()
        return self.ramp

    def step(
        self, time: float, command: Floats, inputs: Inputs, base_velocity: Floats | None
    ) -> Floats:
        """Return joint position targets, rad [12].

        time: s, of the measurements. command: vx, vy in m/s, yaw rate in rad/s [3]. base_velocity:
        m/s [3], in the base's frame; if None, it is estimated from the stance feet.
        """
        config = self.config
        dt = 0.0 if self._time is None else min(max(time - self._time, 0.0), _LONGEST_STEP)
        if self._time is None:
            self._initial_pose = np.array(inputs.position, np.float64)
        self._time = time
        self._elapsed += dt
        gravity, spin = inputs.gravity, inputs.spin
        legs = kinematics.forward(inputs.position)
        asked = clipped(np.asarray(command, np.float64), -self._top, self._top)
        self._command = self._limiter.advance(dt, asked[None])[0]
        self._estimate(legs.feet, gravity, spin, base_velocity, dt)
        self._advance_gait(legs.feet, dt)
        self._move_stance_feet(dt)
        self._move_swing_feet()
        self._plan_joints(dt)
        error = np.zeros(3)
        if self.walking:
            error[:2] = self._command[:2] - self._velocity
            error[2] = self._command[2]
        error[2] -= spin[2]
        torque = stance_torque(
            config.feedback,
            legs,
            self._cycle.load,
            height=config.height,
            gravity=gravity,
            spin=spin,
            velocity_error=error,
        )
        torque += kinematics.leg_weight_torque(legs.angles, gravity)
        torque += config.damping * self._rates
        torque += config.friction * np.tanh(self._rates / 0.3)
        return self._ramp_in((torque / config.stiffness).ravel())

    def _estimate(
        self, feet: Floats, gravity: Floats, spin: Floats, velocity: Floats | None, dt: float
    ) -> None:
        if velocity is None:
            velocity = self._velocity_of_feet(feet, spin, dt)
        self._feet = feet
        share = min(1.0, dt / _FEEDBACK_FILTER)
        self._velocity = self._velocity + share * (np.asarray(velocity)[:2] - self._velocity)
        self._tilt = self._tilt + share * (gravity[:2] / min(gravity[2], -0.3) - self._tilt)
        if not self.walking:
            self._trim = np.zeros(3)
            return
        away = self._command - np.append(self._velocity, spin[2])
        trim = self._trim + self.config.feedback.trim * dt * away
        self._trim = clipped(trim, -_TRIM_LIMIT, _TRIM_LIMIT)

    def _velocity_of_feet(self, feet: Floats, spin: Floats, dt: float) -> Floats:
        bearing = self._cycle.load > 0.9
        if not bearing.any() or dt <= 0.0:
            return self._velocity
        slip = (feet - self._feet)[bearing].mean(axis=0) / dt
        x, y, z = feet[bearing].mean(axis=0)
        return np.array(
            [-slip[0] - spin[1] * z + spin[2] * y, -slip[1] - spin[2] * x + spin[0] * z]
        )

    def _advance_gait(self, feet: Floats, dt: float) -> None:
        ready = self._elapsed >= self.config.ramp
        speed = float(np.hypot(*self._velocity))
        tilt = float(np.hypot(*self._tilt))
        offset = (feet[:, :2] - self._rest[:, :2]).ravel()
        splayed = (offset * _OUTWARD).max() > 0.04 and not self.walking
        asked = np.abs(self._command).max() >= 0.02 or splayed or speed > 0.25 or tilt > 0.2
        self._cycle.advance(
            dt if ready else 0.0,
            self.config.frequency,
            self.config.duty,
            requested=ready and bool(asked),
            settled=speed < 0.15 and tilt < 0.1 and bool(np.abs(offset).max() < 0.08),
        )

    def _move_stance_feet(self, dt: float) -> None:
        places, stance, feedback = self._places, ~self._cycle.swinging, self.config.feedback
        if self.walking:
            velocity = self._command + self._trim
            vx, vy = velocity[:2] + feedback.yielding * (self._velocity - self._command[:2])
            yaw = velocity[2]
            x, y = places[:, 0].copy(), places[:, 1].copy()
            places[:, 0] += dt * stance * (-vx + yaw * y)
            places[:, 1] += dt * stance * (-vy - yaw * x)
        back = min(1.0, feedback.settle * dt) * stance
        places[:, 2] += back * (self._rest[:, 2] - places[:, 2])

    def _move_swing_feet(self) -> None:
        swinging, config = self._cycle.swinging, self.config
        self._lifted_at = np.where(swinging[:, None], self._lifted_at, self._places)
        if not swinging.any():
            return
        rest, command = self._rest, self._command
        half = 0.5 * (config.duty / config.frequency)
        away = config.feedback.foothold * (command[:2] - self._velocity)
        shift = clipped(half * command[:2] - away, _NEAREST_STEP, _FARTHEST_STEP)
        goal = rest.copy()
        goal[:, 0] += shift[0] - half * command[2] * rest[:, 1]
        goal[:, 1] += shift[1] + half * command[2] * rest[:, 0]
        goal[:, 2] -= (goal[:, :2] * self._tilt).sum(axis=1)
        s = clipped(self._cycle.swing_progress, 0.0, 1.0)[:, None]
        start = self._lifted_at
        place = start + s**3 * (10.0 - 15.0 * s + 6.0 * s * s) * (goal - start)
        place[:, 2] += config.swing_height * 16.0 * (s * (1.0 - s))[:, 0] ** 2
        self._places = np.where(swinging[:, None], place, self._places)

    def _plan_joints(self, dt: float) -> None:
        angles = kinematics.inverse(self._places)
        rates = clipped((angles - self.planned) / (dt or 1.0), -10.0, 10.0)
        self._rates = self._rates + min(1.0, dt / _RATE_FILTER) * (rates - self._rates)
        self.planned = angles

    def _ramp_in(self, shift: Floats) -> Floats:
        share = min(self._elapsed / self.config.ramp, 1.0)
        eased = share * share * (3.0 - 2.0 * share)
        target = self._initial_pose + eased * (self.planned.ravel() - self._initial_pose)
        shift = shift * min(1.0, 4.0 * share)
        return clipped(target + shift, TARGET_LIMITS[:, 0], TARGET_LIMITS[:, 1])
