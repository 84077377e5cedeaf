"""
Scripted trot: diagonal legs swing in turn; the output is joint position targets.

It stands in for the paper's standard controller in data collection (Section II-A): velocity
commands and disturbances excite the drives, without learning.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.anymal import LIMITS

from policy_runner.policies import kinematics
from policy_runner.policies.gait_phase import (
    COMMAND_RATE_LIMIT,
    CommandRateLimiter,
    capture_point_error,
    urgency,
)
from policy_runner.policies.stance_torque import stance_torque
from policy_runner.policies.trot_gait import DEFAULT_TROT, TROTS, Feedback, GaitCycle, TrotConfig

__all__ = ['TARGET_LIMITS', 'TROTS', 'Feedback', 'ScriptedTrot', 'TrotConfig']

Floats = NDArray[np.float64]

TARGET_LIMITS: Final = LIMITS + np.array([-0.5, 0.5])
"""Lowest and highest target, rad [12, 2]: joint limits with a margin for torque over stiffness."""

_STEP_LIMIT: Final = (0.28, 0.16)  # m from the foothold at rest, along x and y
_TRIM_LIMIT: Final = 0.15  # m/s, rad/s
_FEEDBACK_FILTER: Final = 0.03  # s, time constant on measured velocity and tilt
_RATE_FILTER: Final = 0.01  # s, time constant on the rates of planned joint angles
_LONGEST_STEP: Final = 0.05  # s


class ScriptedTrot:
    """
    Trot controller from velocity commands to joint position targets.

    Feet follow a plan in the base's frame: stance feet move back with the commanded velocity,
    swing feet move to the centre of the next stance, shifted by the velocity error (Raibert).
    Targets are the joint angles of that plan plus torque over stiffness, so that a compliant
    drive carries the weight and overcomes its friction without a steady error.
    """

    def __init__(self, config: TrotConfig = DEFAULT_TROT) -> None:
        self.config = config
        self._rest = config.footholds
        self._top = np.array([config.max_forward, config.max_lateral, config.max_yaw])
        self._cycle = GaitCycle(config)
        self.reset()

    @property
    def walking(self) -> bool:
        """True while walking, False while standing."""
        return self._cycle.walking

    @property
    def stride(self) -> float:
        """Gait phase, 0..1."""
        return self._cycle.stride

    def reset(self) -> None:
        """Reset; the next step ramps in from the measured pose."""
        self._cycle.reset()
        self._time: float | None = None
        self._elapsed = 0.0
        self._frequency = self.config.frequency
        self._lift = self.config.swing_height
        self._initial_pose = np.zeros(12)
        self._limiter = CommandRateLimiter(COMMAND_RATE_LIMIT)
        self._command = np.zeros(3)
        self._trim = np.zeros(3)
        self._velocity = np.zeros(2)
        self._tilt = np.zeros(2)
        self._places = self._rest.copy()
        self._lifted_at = self._rest.copy()
        self._angles = kinematics.inverse(self._rest)
        self._rates = np.zeros((4, 3))
        self._feet: Floats | None = None

    def step(
        self,
        time: float,
        velocity_command: Floats,
        joint_position: Floats,
        gravity_in_base: Floats,
        angular_velocity: Floats,
        base_velocity: Floats | None = None,
    ) -> Floats:
        """
        Return joint position targets, rad [12]; to be called at 50 to 400 Hz.

        time: s, of the measurements. velocity_command: vx, vy in m/s, yaw rate in rad/s [3].
        joint_position: rad [12]. gravity_in_base: unit vector, (0, 0, -1) when level [3].
        angular_velocity: rad/s [3] and base_velocity: m/s [3], both in the base's frame; without
        a base velocity it is estimated from the stance feet.
        """
        cfg = self.config
        if self._time is None:
            self._time = time
            self._initial_pose = np.array(joint_position, dtype=np.float64)
        dt = min(max(time - self._time, 0.0), _LONGEST_STEP)
        self._time = time
        self._elapsed += dt
        gravity = np.asarray(gravity_in_base, dtype=np.float64)
        spin = np.asarray(angular_velocity, dtype=np.float64)
        legs = kinematics.forward(joint_position)

        command = np.minimum(np.maximum(velocity_command, -self._top), self._top)
        self._command = self._limiter.advance(dt, command[None])[0]
        self._estimate(legs.feet, gravity, spin, base_velocity, dt)
        self._advance_gait(legs.feet, dt)
        self._move_stance_feet(dt)
        self._move_swing_feet()
        self._plan_joints(dt)
        error = np.zeros(3)
        error[2] = -spin[2]
        if self._cycle.walking:
            error[:2] = self._command[:2] - self._velocity
            error[2] += self._command[2]
        torque = stance_torque(
            cfg.feedback,
            legs,
            self._cycle.load,
            height=cfg.height,
            gravity=gravity,
            spin=spin,
            velocity_error=error,
        )
        torque += kinematics.leg_weight_torque(legs.angles, gravity)
        torque += cfg.damping * self._rates + cfg.friction * np.tanh(self._rates / 0.3)
        return self._ramp_in((torque / cfg.stiffness).ravel())

    def _estimate(
        self, feet: Floats, gravity: Floats, spin: Floats, velocity: Floats | None, dt: float
    ) -> None:
        if velocity is None:
            velocity = self._velocity_of_feet(feet, spin, dt)
        self._feet = feet
        share = min(1.0, dt / _FEEDBACK_FILTER)
        self._velocity = self._velocity + share * (velocity[:2] - self._velocity)
        self._tilt = self._tilt + share * (gravity[:2] / min(gravity[2], -0.3) - self._tilt)
        if self._cycle.walking:
            reached = np.array([self._velocity[0], self._velocity[1], spin[2]])
            trim = self._trim + self.config.feedback.trim * dt * (self._command - reached)
            self._trim = np.minimum(np.maximum(trim, -_TRIM_LIMIT), _TRIM_LIMIT)
        else:
            self._trim = np.zeros(3)

    def _velocity_of_feet(self, feet: Floats, spin: Floats, dt: float) -> Floats:
        bearing = self._cycle.load > 0.9
        if self._feet is None or dt <= 0.0 or not bearing.any():
            return self._velocity
        slip = (feet - self._feet)[bearing].mean(axis=0) / dt
        x, y, z = feet[bearing].mean(axis=0)
        return np.array(
            [-slip[0] - spin[1] * z + spin[2] * y, -slip[1] - spin[2] * x + spin[0] * z]
        )

    def _advance_gait(self, feet: Floats, dt: float) -> None:
        cfg = self.config
        if self._elapsed < cfg.ramp:
            return
        if cfg.cadence_adaptation:
            error = capture_point_error(self._command[:2] - self._velocity, self._tilt)
            share = float(urgency(cfg.cadence_adaptation, error))
            self._frequency = cfg.frequency + share * (cfg.cadence_adaptation[0] - cfg.frequency)
            self._lift = cfg.swing_height + share * (cfg.urgent_swing_height - cfg.swing_height)
        speed = float(np.hypot(*self._velocity))
        tilt = float(np.hypot(*self._tilt))
        commanded = float(np.abs(self._command).max()) >= 0.02
        offset = (feet - self._rest)[:, :2]
        outward = float((offset * np.sign(self._rest[:, :2])).max())
        splayed = outward > 0.04 and not self._cycle.walking
        self._cycle.advance(
            dt,
            self._frequency,
            requested=commanded or splayed or speed > 0.25 or tilt > 0.2,
            settled=speed < 0.15 and tilt < 0.1 and float(np.abs(offset).max()) < 0.08,
        )

    def _move_stance_feet(self, dt: float) -> None:
        places, stance = self._places, ~self._cycle.swinging
        if self._cycle.walking:
            feedback, command = self.config.feedback, self._command
            vx, vy, yaw = self.config.stance_speed * command + self._trim
            vx += feedback.yielding * (self._velocity[0] - command[0])
            vy += feedback.yielding * (self._velocity[1] - command[1])
            moved = np.empty((4, 2))
            moved[:, 0] = -vx + yaw * places[:, 1]
            moved[:, 1] = -vy - yaw * places[:, 0]
            places[:, :2] += dt * stance[:, None] * moved
        back = min(1.0, self.config.feedback.settle * dt) * stance
        places[:, 2] += back * (self._rest[:, 2] - places[:, 2])

    def _move_swing_feet(self) -> None:
        cycle, cfg = self._cycle, self.config
        swinging = cycle.swinging
        if not swinging.any():
            self._lifted_at = self._places.copy()
            return
        self._lifted_at[~swinging] = self._places[~swinging]
        rest = self._rest[swinging]
        half = 0.5 * (cfg.duty / self._frequency)
        turn = half * self._command[2]
        shift = half * self._command[:2] - cfg.feedback.foothold * (
            self._command[:2] - self._velocity
        )
        goal = rest.copy()
        goal[:, 0] += min(max(shift[0], -_STEP_LIMIT[0]), _STEP_LIMIT[0]) - turn * rest[:, 1]
        goal[:, 1] += min(max(shift[1], -_STEP_LIMIT[1]), _STEP_LIMIT[1]) + turn * rest[:, 0]
        goal[:, 2] -= goal[:, :2] @ self._tilt
        s = np.minimum(cycle.swing_progress[swinging], 1.0)[:, None]
        start = self._lifted_at[swinging]
        place = start + s**3 * (10.0 - 15.0 * s + 6.0 * s * s) * (goal - start)
        place[:, 2] += self._lift * 16.0 * (s * (1.0 - s))[:, 0] ** 2
        self._places[swinging] = place

    def _plan_joints(self, dt: float) -> None:
        angles = kinematics.inverse(self._places)
        if dt > 0.0:
            rates = np.minimum(np.maximum((angles - self._angles) / dt, -10.0), 10.0)
            self._rates += min(1.0, dt / _RATE_FILTER) * (rates - self._rates)
        self._angles = angles

    def _ramp_in(self, shift: Floats) -> Floats:
        target = self._angles.ravel()
        share = self._elapsed / self.config.ramp
        if share < 1.0:
            target = self._initial_pose + share * share * (3.0 - 2.0 * share) * (
                target - self._initial_pose
            )
            shift = shift * min(1.0, 4.0 * share)
        return np.minimum(np.maximum(target + shift, TARGET_LIMITS[:, 0]), TARGET_LIMITS[:, 1])
