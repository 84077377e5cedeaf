"""A scripted trot: diagonal legs swing in turn, joint position targets only.

It plays the role of the paper's standard controller when data are collected (Section II-A):
commands in the plane and disturbances excite the drives, no learning involved.
"""

from dataclasses import dataclass, fields
from typing import Final

import numpy as np
from numpy.typing import NDArray

from policy_runner import kinematics
from policy_runner.kinematics import FOOT_RADIUS, FRONT, GRAVITY, LEFT, LIMITS

Floats = NDArray[np.float64]

ROBOT_MASS: Final = 52.135  # kg
_OFFSET: Final = np.array([0.0, 0.5, 0.5, 0.0])
_BOUNDS: Final = {
    'frequency': (0.8, 3.0),
    'duty': (0.5, 0.85),
    'height': (0.40, 0.58),
    'swing_height': (0.02, 0.2),
    'foot_x': (0.25, 0.55),
    'foot_y': (0.2, 0.42),
    'max_forward': (0.0, 1.5),
    'max_lateral': (0.0, 1.0),
    'max_yaw': (0.0, 2.0),
    'stiffness': (20.0, 400.0),
    'damping': (0.0, 30.0),
    'friction': (0.0, 10.0),
}


@dataclass(frozen=True)
class TrotConfig:
    """
    Shape of the gait and what it knows of the drives; ValueError if a value is out of bounds.

    frequency: strides a second. duty: share of a stride on the ground. height: base over
    ground, m. swing_height: m. foot_x, foot_y: feet under the base, m. max_*: what commands are
    clipped to, m/s and rad/s. stiffness: position gain of the drives, N·m/rad. damping: their
    velocity gain and gear friction together, N·m·s/rad. friction: N·m to overcome at rest.
    """

    frequency: float = 1.8
    duty: float = 0.58
    height: float = 0.52
    swing_height: float = 0.08
    foot_x: float = 0.40
    foot_y: float = 0.30
    max_forward: float = 0.8
    max_lateral: float = 0.6
    max_yaw: float = 0.9
    stiffness: float = 80.0
    damping: float = 6.5
    friction: float = 1.5
    ramp: float = 1.5

    # tuning
    kv_foot: float = 0.12
    kv_force: float = 250.0
    k_tilt: float = 500.0
    d_tilt: float = 50.0
    k_height: float = 3000.0
    k_yaw: float = 60.0
    slide: float = 0.3
    settle: float = 6.0

    def __post_init__(self) -> None:
        for item in fields(self):
            low, high = _BOUNDS.get(item.name, (-np.inf, np.inf))
            value = getattr(self, item.name)
            if not low <= value <= high:
                raise ValueError(f'trot {item.name} is {value!r}; it must lie in {low}..{high}')


class ScriptedTrot:
    """Walks by velocity command; see step()."""

    def __init__(self, config: TrotConfig = TrotConfig()) -> None:
        self.config = config
        self._nominal = np.column_stack(
            [config.foot_x * FRONT, config.foot_y * LEFT, np.full(4, FOOT_RADIUS - config.height)]
        )
        self.reset()

    def reset(self) -> None:
        """Forget everything; the next step ramps in from the pose that it is given."""
        self._time: float | None = None
        self._start_time = 0.0
        self._start_pose = np.zeros(12)
        self._phase = 0.0
        self._walking = False
        self._quiet = 0.0
        self._command = np.zeros(3)
        self._velocity = np.zeros(3)
        self._places = self._nominal.copy()
        self._lift = self._nominal.copy()
        self._swinging = np.zeros(4, dtype=bool)
        self._angles = kinematics.inverse(self._nominal)
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
        cfg = self.config
        if self._time is None:
            self._time = self._start_time = time
            self._start_pose = np.array(joint_position, dtype=np.float64)
        dt = min(max(time - self._time, 0.0), 0.05)
        self._time = time
        legs = kinematics.forward(joint_position)
        gravity = np.asarray(gravity_in_base, dtype=np.float64)
        spin = np.asarray(angular_velocity, dtype=np.float64)
        self._limit_command(velocity_command, dt)
        self._estimate_velocity(legs.feet, spin, base_velocity, dt)
        self._advance(dt, gravity)
        cmd, vel = self._command, self._velocity
        # phases
        phase = (self._phase + _OFFSET) % 1.0
        swinging = (phase >= cfg.duty) if self._walking else np.zeros(4, dtype=bool)
        lifted = swinging & ~self._swinging
        self._lift[lifted] = self._places[lifted]
        self._swinging = swinging
        stance = ~swinging
        self._move_stance(stance, legs.feet, dt)
        if swinging.any():
            self._move_swing(swinging, (phase - cfg.duty) / (1 - cfg.duty), gravity)
        angles = kinematics.inverse(self._places)
        if dt > 0:
            rates = (angles - self._angles) / dt
            self._rates += min(1.0, dt / 0.01) * (np.clip(rates, -10, 10) - self._rates)
        self._angles = angles
        # load share
        if self._walking:
            edge = 0.06
            share = np.clip(np.minimum(phase, cfg.duty - phase) / edge, 0.0, 1.0) * stance
        else:
            share = np.ones(4)
        torque = kinematics.leg_weight_torque(legs.angles, gravity)
        torque += self._stance_torque(share, legs, gravity, spin, cmd, vel)
        torque += cfg.damping * self._rates + cfg.friction * np.tanh(self._rates / 0.3)
        target = (angles + torque / cfg.stiffness).ravel()
        ramp = (time - self._start_time) / cfg.ramp
        if ramp < 1.0:
            blend = ramp * ramp * (3 - 2 * ramp)
            target = self._start_pose + blend * (target - self._start_pose)
        return np.clip(target, LIMITS[:, 0], LIMITS[:, 1])

    def _limit_command(self, command: Floats, dt: float) -> None:
        cfg = self.config
        top = np.array([cfg.max_forward, cfg.max_lateral, cfg.max_yaw])
        change = np.clip(command, -top, top) - self._command
        most = np.array([1.0, 1.0, 2.0]) * dt
        self._command += np.clip(change, -most, most)

    def _estimate_velocity(self, feet, spin, base_velocity, dt) -> None:
        if base_velocity is not None:
            self._velocity = np.asarray(base_velocity, dtype=np.float64)
        elif self._feet is not None and dt > 0:
            stance = ~self._swinging
            moved = (feet[stance] - self._feet[stance]) / dt
            seen = -moved - np.cross(spin, feet[stance])
            self._velocity = self._velocity + min(1.0, dt / 0.04) * (
                seen.mean(axis=0) - self._velocity
            )
        self._feet = feet

    def _advance(self, dt: float, gravity: Floats) -> None:
        cfg = self.config
        if self._time - self._start_time < cfg.ramp:
            return
        tilt = np.hypot(gravity[0], gravity[1])
        still = np.abs(self._command).max() < 0.02
        speed = np.hypot(self._velocity[0], self._velocity[1])
        astray = np.abs((self._places - self._nominal)[:, :2]).max()
        if not self._walking:
            if not still or speed > 0.25 or tilt > 0.2:
                self._walking = True
                self._phase = 0.0 if self._velocity[1] * 1 >= 0 else 0.5
                self._quiet = 0.0
            return
        before = self._phase
        self._phase = (self._phase + cfg.frequency * dt) % 1.0
        calm = still and speed < 0.15 and tilt < 0.1 and astray < 0.06
        self._quiet = self._quiet + dt if calm else 0.0
        crossing = (before % 0.5) > (self._phase % 0.5)
        if crossing and self._quiet > 0.5 / cfg.frequency:
            self._walking = False

    def _move_stance(self, stance, feet, dt) -> None:
        cfg = self.config
        places = self._places
        travel = self._command[:2] + cfg.slide * (self._velocity[:2] - self._command[:2])
        if not self._walking:
            travel = np.zeros(2)
        yaw = self._command[2] if self._walking else 0.0
        moved = np.empty((4, 2))
        moved[:, 0] = -travel[0] + yaw * places[:, 1]
        moved[:, 1] = -travel[1] - yaw * places[:, 0]
        places[:, :2] += dt * stance[:, None] * moved
        pull = min(1.0, cfg.settle * dt) * stance
        places[:, 2] += pull * (self._nominal[:, 2] - places[:, 2])

    def _move_swing(self, swinging, progress, gravity) -> None:
        cfg = self.config
        s = np.clip(progress[swinging], 0.0, 1.0)[:, None]
        nominal = self._nominal[swinging]
        stance_time = cfg.duty / cfg.frequency
        left = (1 - s) * (1 - cfg.duty) / cfg.frequency
        cmd, vel = self._command, self._velocity
        yaw = cmd[2] * (0.5 * stance_time)
        target = nominal.copy()
        shift = 0.5 * stance_time * cmd[:2] + cfg.kv_foot * (vel[:2] - cmd[:2])
        shift = np.clip(shift, [-0.28, -0.16], [0.28, 0.16])
        target[:, 0] += shift[0] - yaw * nominal[:, 1]
        target[:, 1] += shift[1] + yaw * nominal[:, 0]
        # land level: the plane z = -height of the gravity-aligned frame, seen from the base
        target[:, 2] += -(gravity[0] * target[:, 0] + gravity[1] * target[:, 1]) / gravity[2]
        lift = self._lift[swinging]
        path = s * s * s * (10 - 15 * s + 6 * s * s)
        place = lift + path * (target - lift)
        place[:, 2] += cfg.swing_height * 16 * (s * (1 - s))[:, 0] ** 2
        self._places[swinging] = place

    def _stance_torque(self, share, legs, gravity, spin, cmd, vel) -> Floats:
        cfg = self.config
        total = share.sum()
        if total < 0.5:
            return np.zeros((4, 3))
        feet = legs.feet
        height = -(share * feet[:, 2]).sum() / total + FOOT_RADIUS
        weight = ROBOT_MASS * GRAVITY * -gravity[2] * 0.5  # leg weight handled apart
        roll, pitch = -gravity[1], gravity[0]
        wrench = np.array(
            [
                ROBOT_MASS * GRAVITY + cfg.k_height * np.clip(cfg.height - height, -0.05, 0.05),
                -cfg.k_tilt * roll - cfg.d_tilt * spin[0],
                -cfg.k_tilt * pitch - cfg.d_tilt * spin[1],
            ]
        )
        arms = np.empty((3, 4))
        arms[0] = 1.0
        arms[1] = feet[:, 1]
        arms[2] = -feet[:, 0]
        weighted = arms * share
        normal = weighted.T @ np.linalg.solve(
            weighted @ arms.T + np.diag([1e-3, 1e-3, 1e-3]), wrench
        )
        normal = np.clip(normal, 0.0, 500.0) * (share > 0)
        force = np.zeros((4, 3))
        force[:, 2] = normal
        push = cfg.kv_force * (cmd[:2] - vel[:2]) if self._walking else np.zeros(2)
        push = np.clip(push, -120, 120)
        part = normal / max(normal.sum(), 50.0)
        twist = cfg.k_yaw * (cmd[2] * self._walking - spin[2])
        lever = (part * (feet[:, 0] ** 2 + feet[:, 1] ** 2)).sum() + 1e-3
        force[:, 0] = part * (push[0] - twist * feet[:, 1] / lever)
        force[:, 1] = part * (push[1] + twist * feet[:, 0] / lever)
        # horizontal forces tip the body; forces are along gravity
        force += -(normal[:, None]) * (gravity + np.array([0, 0, 1.0]))
        return -np.einsum('lij,li->lj', legs.jacobian, force)
