"""Drives of N robots at the time step of training.

The same loops as `sim_bridge.plant.drive`: PD on the joint's position and on the rotor's speed, or
on the joint's with a torque loop on the spring's deflection, gear friction on the rotor, the
series spring between rotor and joint, and a delay that differs between robots. Rotors take a few
steps of their own within each of the rigid bodies'.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray
from sim_bridge.plant.drive import torque_loop
from sim_bridge.plant.parameters import Plant
from wattwalk_core.anymal import JOINT_NAMES, POSITION_GAIN, VELOCITY_GAIN
from wattwalk_core.arrays import Floats

from policy_training.config import RandomConfig

_SETTLING: Final = 0.03  # rad/s below which dry friction acts as a damper
_ROTOR_STEPS: Final = 4  # in one time step of the rigid bodies; 16 change motor torque by 2 %
_LIGHTEST: Final = 1e-3  # kg·m², rotor of a plant whose rotors weigh nothing
_RIGID: Final = 4000.0  # N·m/rad, of a drive without a spring


class BatchDrives:
    """N robots' drives, [N, 12] each.

    What a spring hands to its joint in a time step depends on where the joint goes meanwhile.
    The part of its torque that grows with the joint's speed is therefore left to the rigid
    bodies as `joint_damping`, which MuJoCo steps implicitly: so the two neither chatter nor feed
    energy in, though the step is long for a light shank on a stiff spring.
    """

    def __init__(
        self,
        plant: Plant,
        count: int,
        timestep: float,
        spread: RandomConfig,
        random: np.random.Generator,
    ) -> None:
        p, effects = plant.resolve(JOINT_NAMES), plant.effects

        def vary(values: Floats, width: float) -> Floats:
            return values * random.uniform(1.0 - width, 1.0 + width, (count, 12))

        rub = spread.drive_friction
        self._coulomb = vary(p['coulomb'] * effects.coulomb_friction.scale, rub)
        self._stribeck = vary(p['stribeck'] * effects.stribeck_friction.scale, rub)
        self._viscous = vary(p['viscous'] * effects.viscous_friction.scale, rub)
        self._load = vary(p['load_friction'] * effects.load_friction.scale, rub)
        self._fade = 1.0 / p['stribeck_velocity']
        self._thin = 1.0 / p['shear_velocity']
        self._limit = p['torque_limit']
        rotor = np.maximum(p['rotor_inertia'] * effects.rotor_inertia.scale, _LIGHTEST)
        self._inertia = vary(rotor, spread.inertia)
        spring = effects.spring
        self._spring = (
            p['spring_stiffness'] / max(spring.strength, 1e-3)
            if spring.enabled
            else np.full(12, _RIGID)
        )
        self._damper = p['spring_damping']
        p['loop_bandwidth'] = vary(p['loop_bandwidth'], spread.torque_loop)
        self._gain, self._loop_damping = torque_loop(plant, p, self._inertia, self._spring)
        self._stiffness = vary(np.full(12, POSITION_GAIN), spread.stiffness)
        damping = vary(np.full(12, VELOCITY_GAIN), spread.stiffness)
        closed = effects.torque_loop.enabled
        self._joint_damping = damping * closed
        self._rotor_damping = damping - self._joint_damping
        self._timestep = timestep
        soonest, latest = plant.command_delay + spread.delay * np.array([-1.0, 1.0])
        delay = random.uniform(max(soonest, 0.0), latest, count)
        self._delay = np.rint(delay / timestep).astype(int)
        self.joint_damping: Floats = self._damper + 0.5 * timestep * self._spring  # [12]
        self.target = np.zeros((count, 12))
        self._next = np.zeros((count, 12))
        self._sent = np.zeros((int(self._delay.max(initial=0)) + 1, count, 12))
        self._steps = 0
        self._rotor = np.zeros((count, 12))
        self._speed = np.zeros((count, 12))
        self._motor = np.zeros((count, 12))
        self._given = np.zeros((count, 12))
        self.rotor_speed = np.zeros((count, 12))
        """Mean of the last time step, rad/s, in turns of the joint."""

    def start(self, ids: NDArray[np.intp], pose: Floats) -> None:
        """Reset the drives of some robots to rest in a pose, rad [len(ids), 12]."""
        self.target[ids] = pose
        self._next[ids] = pose
        self._sent[:, ids] = pose
        self._rotor[ids] = pose
        self._speed[ids] = 0.0
        self._motor[ids] = 0.0

    def aim(self, targets: Floats) -> None:
        """Send targets, rad, which each robot's drives follow after their delay."""
        self._next[:] = targets

    def push(self, position: Floats, velocity: Floats) -> tuple[Floats, Floats]:
        """Advance the rotors by one time step, with joints at positions, rad, and speeds, rad/s.

        Returns the mean torque of the motors and, less what `joint_damping` makes of the joint's
        speed after the step, that on the joints, both N·m.
        """
        self._sent[self._steps % len(self._sent)] = self._next
        arrived = (self._steps - self._delay) % len(self._sent)
        self.target[:] = self._sent[arrived, np.arange(len(arrived))]
        self._steps += 1
        # Implicit in the rotor's speed after the step: inertia · (after − speed) / h = motor
        # − drag · after − twist, motor = gain · wish − (gain − 1) · deflection
        # − loop damping · (after − velocity), with deflection and twist after the step.
        h = self._timestep / _ROTOR_STEPS
        per_inertia = h / self._inertia
        stiffness, damper, gain = self._spring, self._damper, 1.0 + self._gain
        of_twist = damper + h * stiffness  # N·m·s/rad of the speed after the step
        of_all = gain * (self._rotor_damping + h * stiffness) + damper + self._loop_damping
        rotor, speed, motor = self._rotor, self._speed, self._motor
        mean_motor, mean_rotor, mean_speed = (np.zeros_like(rotor) for _ in range(3))
        for index in range(_ROTOR_STEPS):
            joint = position + velocity * (h * (index + 1))
            deflection = stiffness * (rotor - joint)
            twist = deflection - damper * velocity
            drag = self._drag(np.abs(speed), np.abs(motor))
            wish = self._stiffness * (self.target - joint + h * velocity)
            wish -= self._joint_damping * velocity
            push = gain * (wish - deflection) + (damper + self._loop_damping) * velocity
            after = (speed + per_inertia * push) / (1.0 + per_inertia * (of_all + drag))
            motor = push + twist - (of_all - of_twist) * after
            over = np.abs(motor) > self._limit
            np.clip(motor, -self._limit, self._limit, out=motor)
            limited = speed + per_inertia * (motor - twist)
            speed = np.where(over, limited / (1.0 + per_inertia * (of_twist + drag)), after)
            mean_motor += motor
            mean_rotor += rotor + 0.5 * h * speed
            rotor = rotor + h * speed
            mean_speed += speed
        self._rotor, self._speed, self._motor = rotor, speed, motor
        share = 1.0 / _ROTOR_STEPS
        self.rotor_speed = mean_speed * share
        self._given = self._spring * (mean_rotor * share - position)
        self._given += self._damper * (mean_speed * share)
        return mean_motor * share, self._given

    def output(self, after: Floats) -> Floats:
        """Return the joint torque of the last time step, N·m, given the speeds after it, rad/s."""
        return self._given - self.joint_damping * after

    def _drag(self, speed: Floats, motor: Floats) -> Floats:
        """Return friction as damping, N·m·s/rad, at absolute rotor speed and motor torque."""
        slow = 1.0 + np.square(speed * self._fade)
        dry = self._coulomb + self._stribeck / (slow * slow) + self._load * motor
        damping: Floats = self._viscous / (1.0 + speed * self._thin) + dry / (speed + _SETTLING)
        return damping
