"""Scripted trot: diagonal legs swing in turn; the output is joint position targets.

It stands in for the paper's standard controller in data collection (Section II-A): velocity
commands and disturbances excite the drives, without learning.
"""

from collections.abc import Sequence
from dataclasses import fields
from typing import Final

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.anymal import FRONT, LEFT, LIMITS
from wattwalk_core.arrays import Bools, Floats

from policy_runner.policies import kinematics
from policy_runner.policies.command_rate import COMMAND_RATE_LIMIT, CommandRateLimiter
from policy_runner.policies.kinematics import clipped, stance_torque
from policy_runner.policies.trot_gait import (
    DEFAULT_TROT,
    TROTS,
    Feedback,
    GaitCycle,
    TrotConfig,
)

__all__ = ['TARGET_LIMITS', 'TROTS', 'Feedback', 'ScriptedTrot', 'ScriptedTrots', 'TrotConfig']


TARGET_LIMITS: Final = LIMITS + np.array([-0.5, 0.5])
"""Lowest and highest target, rad [12, 2]: joint limits with a margin for torque over stiffness."""

_FARTHEST_STEP: Final = np.array([0.28, 0.16])  # m from the foothold at rest, along x and y
_NEAREST_STEP: Final = -_FARTHEST_STEP
_OUTWARD: Final = np.column_stack([FRONT, LEFT]).ravel()
_TRIM_LIMIT: Final = 0.15  # m/s, rad/s
_FEEDBACK_FILTER: Final = 0.03  # s, time constant on measured velocity and tilt
_RATE_FILTER: Final = 0.01  # s, time constant on the rates of planned joint angles
_LONGEST_STEP: Final = 0.05  # s


class ScriptedTrots:
    """Trot controllers of N robots, each of its own gait, from velocity commands to joint targets.

    Feet follow a plan in the base's frame: stance feet move back with the commanded velocity,
    swing feet move to the centre of the next stance, shifted by the velocity error (Raibert).
    Targets are the joint angles of that plan plus torque over stiffness, so that a compliant
    drive carries the weight and overcomes its friction without a steady error.
    """

    def __init__(self, configs: Sequence[TrotConfig]) -> None:
        self.configs = tuple(configs)
        count = len(self.configs)
        self._p = {
            name: np.array([getattr(config, name) for config in configs], np.float64)
            for name in (
                *('frequency', 'duty', 'height', 'swing_height', 'ramp'),
                *('stiffness', 'damping', 'friction'),
            )
        }
        self._gains = {
            item.name: np.array([getattr(config.feedback, item.name) for config in configs])
            for item in fields(Feedback)
        }
        self._rest = np.array([config.footholds for config in configs])
        self._top = np.array([[c.max_forward, c.max_lateral, c.max_yaw] for c in configs])
        self._cycle = GaitCycle(count)
        self._limiter = CommandRateLimiter(COMMAND_RATE_LIMIT, count)
        self._time: float | None = None
        self._fresh = np.ones(count, bool)
        self._elapsed = np.zeros(count)
        self._initial_pose = np.zeros((count, 12))
        self._trim = np.zeros((count, 3))
        self._velocity = np.zeros((count, 2))
        self._tilt = np.zeros((count, 2))
        self._places = np.zeros((count, 4, 3))
        self._lifted_at = np.zeros((count, 4, 3))
        self.planned = np.zeros((count, 4, 3))  # rad, without the shift for torque
        self._rates = np.zeros((count, 4, 3))
        self._feet = np.zeros((count, 4, 3))
        self.reset()

    @property
    def walking(self) -> Bools:
        """True for robots that walk, False for those that stand [N]."""
        return self._cycle.walking

    @property
    def stride(self) -> Floats:
        """Gait phases, 0..1 [N]."""
        return self._cycle.stride

    def reset(self, ids: NDArray[np.intp] | None = None) -> None:
        """Reset the robots of these indices, or all; their next step ramps in from their pose."""
        who = np.arange(len(self.configs)) if ids is None else ids
        if ids is None:
            self._time = None
        self._cycle.reset(who)
        self._limiter.values[who] = 0.0
        self._fresh[who] = True
        for values in (self._elapsed, self._trim, self._velocity, self._tilt, self._rates):
            values[who] = 0.0
        self._places[who] = self._lifted_at[who] = self._rest[who]
        self.planned[who] = kinematics.inverse(self._rest[who])

    def step(
        self,
        time: float,
        velocity_command: Floats,
        joint_position: Floats,
        gravity_in_base: Floats,
        angular_velocity: Floats,
        base_velocity: Floats | None = None,
    ) -> Floats:
        """Return joint position targets, rad [N, 12]; to be called at 50 to 400 Hz.

        time: s, of the measurements. velocity_command: vx, vy in m/s, yaw rate in rad/s [N, 3].
        joint_position: rad [N, 12]. gravity_in_base: unit vectors, (0, 0, -1) when level [N, 3].
        angular_velocity: rad/s [N, 3] and base_velocity: m/s [N, 3], both in the base's frame;
        without a base velocity it is estimated from the stance feet.
        """
        if self._fresh.any():
            self._initial_pose[self._fresh] = np.asarray(joint_position)[self._fresh]
        passed = 0.0 if self._time is None else min(max(time - self._time, 0.0), _LONGEST_STEP)
        self._time = time
        dt = np.where(self._fresh, 0.0, passed)
        self._elapsed = self._elapsed + dt
        gravity = np.asarray(gravity_in_base, dtype=np.float64)
        spin = np.asarray(angular_velocity, dtype=np.float64)
        legs = kinematics.forward(joint_position)
        command = clipped(velocity_command, -self._top, self._top)
        self._command = self._limiter.advance(dt[:, None], command)
        self._estimate(legs.feet, gravity, spin, base_velocity, dt)
        self._advance_gait(legs.feet, dt)
        self._move_stance_feet(dt)
        self._move_swing_feet()
        self._plan_joints(dt)
        walking = self._cycle.walking[:, None]
        error = np.empty_like(self._command)
        error[:, :2] = np.where(walking, self._command[:, :2] - self._velocity, 0.0)
        error[:, 2:] = np.where(walking, self._command[:, 2:], 0.0) - spin[:, 2:]
        torque = stance_torque(
            self._gains,
            legs,
            self._cycle.load,
            height=self._p['height'],
            gravity=gravity,
            spin=spin,
            velocity_error=error,
        )
        torque += kinematics.leg_weight_torque(legs.angles, gravity)
        torque += self._p['damping'][:, None, None] * self._rates
        torque += self._p['friction'][:, None, None] * np.tanh(self._rates / 0.3)
        self._fresh[:] = False
        return self._ramp_in((torque / self._p['stiffness'][:, None, None]).reshape(-1, 12))

    def _estimate(
        self, feet: Floats, gravity: Floats, spin: Floats, velocity: Floats | None, dt: Floats
    ) -> None:
        if velocity is None:
            velocity = self._velocity_of_feet(feet, spin, dt)
        self._feet = feet
        share = np.minimum(1.0, dt / _FEEDBACK_FILTER)[:, None]
        self._velocity = self._velocity + share * (np.asarray(velocity)[:, :2] - self._velocity)
        tilt = gravity[:, :2] / np.minimum(gravity[:, 2:], -0.3)
        self._tilt = self._tilt + share * (tilt - self._tilt)
        reached = np.concatenate([self._velocity, spin[:, 2:]], axis=1)
        rate = (self._gains['trim'] * dt)[:, None]
        trim = clipped(self._trim + rate * (self._command - reached), -_TRIM_LIMIT, _TRIM_LIMIT)
        self._trim = np.where(self._cycle.walking[:, None], trim, 0.0)

    def _velocity_of_feet(self, feet: Floats, spin: Floats, dt: Floats) -> Floats:
        bearing = (self._cycle.load > 0.9)[..., None]
        count = np.maximum(bearing.sum(axis=1), 1)
        slip = (bearing * (feet - self._feet)).sum(axis=1) / count
        slip = slip / np.where(dt > 0.0, dt, 1.0)[:, None]
        x, y, z = ((bearing * feet).sum(axis=1) / count).T
        found = np.column_stack(
            [
                -slip[:, 0] - spin[:, 1] * z + spin[:, 2] * y,
                -slip[:, 1] - spin[:, 2] * x + spin[:, 0] * z,
            ]
        )
        known = bearing.any(axis=1) & (dt > 0.0)[:, None]
        return np.where(known, found, self._velocity)

    def _advance_gait(self, feet: Floats, dt: Floats) -> None:
        ready = self._elapsed >= self._p['ramp']
        speed = np.hypot(self._velocity[:, 0], self._velocity[:, 1])
        tilt = np.hypot(self._tilt[:, 0], self._tilt[:, 1])
        commanded = np.abs(self._command).max(axis=1) >= 0.02
        offset = (feet[..., :2] - self._rest[..., :2]).reshape(-1, 8)
        outward = (offset * _OUTWARD).max(axis=1)
        splayed = (outward > 0.04) & ~self._cycle.walking
        near = np.abs(offset).max(axis=1) < 0.08
        self._cycle.advance(
            np.where(ready, dt, 0.0),
            self._p['frequency'],
            self._p['duty'],
            requested=ready & (commanded | splayed | (speed > 0.25) | (tilt > 0.2)),
            settled=(speed < 0.15) & (tilt < 0.1) & near,
        )

    def _move_stance_feet(self, dt: Floats) -> None:
        places, stance = self._places, ~self._cycle.swinging
        moving = (self._cycle.walking * dt)[:, None] * stance
        velocity = self._command + self._trim
        give = self._gains['yielding'][:, None]
        vx, vy = (velocity[:, :2] + give * (self._velocity - self._command[:, :2])).T
        yaw = velocity[:, 2]
        x, y = places[..., 0].copy(), places[..., 1].copy()
        places[..., 0] += moving * (-vx[:, None] + yaw[:, None] * y)
        places[..., 1] += moving * (-vy[:, None] - yaw[:, None] * x)
        back = np.minimum(1.0, self._gains['settle'] * dt)[:, None] * stance
        places[..., 2] += back * (self._rest[..., 2] - places[..., 2])

    def _move_swing_feet(self) -> None:
        swinging = self._cycle.swinging
        self._lifted_at = np.where(swinging[..., None], self._lifted_at, self._places)
        if not swinging.any():
            return
        rest, command = self._rest, self._command
        half = 0.5 * (self._p['duty'] / self._p['frequency'])
        turn = (half * command[:, 2])[:, None]
        away = self._gains['foothold'][:, None] * (command[:, :2] - self._velocity)
        shift = clipped(half[:, None] * command[:, :2] - away, _NEAREST_STEP, _FARTHEST_STEP)
        goal = rest.copy()
        goal[..., 0] += shift[:, :1] - turn * rest[..., 1]
        goal[..., 1] += shift[:, 1:] + turn * rest[..., 0]
        goal[..., 2] -= (goal[..., :2] * self._tilt[:, None]).sum(axis=2)
        s = clipped(self._cycle.swing_progress, 0.0, 1.0)[..., None]
        start = self._lifted_at
        place = start + s**3 * (10.0 - 15.0 * s + 6.0 * s * s) * (goal - start)
        place[..., 2] += self._p['swing_height'][:, None] * 16.0 * (s * (1.0 - s))[..., 0] ** 2
        self._places = np.where(swinging[..., None], place, self._places)

    def _plan_joints(self, dt: Floats) -> None:
        angles = kinematics.inverse(self._places)
        step = np.where(dt > 0.0, dt, 1.0)[:, None, None]
        rates = clipped((angles - self.planned) / step, -10.0, 10.0)
        share = np.minimum(1.0, dt / _RATE_FILTER)[:, None, None]
        self._rates = self._rates + share * (rates - self._rates)
        self.planned = angles

    def _ramp_in(self, shift: Floats) -> Floats:
        target = self.planned.reshape(-1, 12)
        share = np.minimum(self._elapsed / self._p['ramp'], 1.0)[:, None]
        eased = share * share * (3.0 - 2.0 * share)
        target = self._initial_pose + eased * (target - self._initial_pose)
        shift = shift * np.minimum(1.0, 4.0 * share)
        return clipped(target + shift, TARGET_LIMITS[:, 0], TARGET_LIMITS[:, 1])


class ScriptedTrot:
    """The trot controller of one robot; see `ScriptedTrots`."""

    def __init__(self, config: TrotConfig = DEFAULT_TROT) -> None:
        self.config = config
        self._trots = ScriptedTrots([config])

    @property
    def walking(self) -> bool:
        """True while walking, False while standing."""
        return bool(self._trots.walking[0])

    @property
    def stride(self) -> float:
        """Gait phase, 0..1."""
        return float(self._trots.stride[0])

    @property
    def planned(self) -> Floats:
        """Joint angles of the plan, without the shift for torque, rad [4, 3]."""
        return self._trots.planned[0]

    def reset(self) -> None:
        """Reset; the next step ramps in from the measured pose."""
        self._trots.reset()

    def step(
        self,
        time: float,
        velocity_command: Floats,
        joint_position: Floats,
        gravity_in_base: Floats,
        angular_velocity: Floats,
        base_velocity: Floats | None = None,
    ) -> Floats:
        """Return joint position targets, rad [12]; arguments as for N robots, without N."""
        return self._trots.step(
            time,
            np.asarray(velocity_command, np.float64)[None],
            np.asarray(joint_position, np.float64)[None],
            np.asarray(gravity_in_base, np.float64)[None],
            np.asarray(angular_velocity, np.float64)[None],
            None if base_velocity is None else np.asarray(base_velocity, np.float64)[None],
        )[0]
