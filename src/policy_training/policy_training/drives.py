"""
The drives of N robots at the time step of training.

The same loop as `sim_bridge.drive` at a tenth of its rate: PD on position, gear friction, the
series spring as a softer loop, and a delay that differs between robots.
"""

import numpy as np
from numpy.typing import NDArray
from sim_bridge.drive import POSITION_GAIN, VELOCITY_GAIN
from sim_bridge.plant import Plant
from sim_bridge.robot import JOINT_NAMES

from policy_training.config import RandomConfig

Floats = NDArray[np.float64]

_SETTLING = 0.1  # rad/s below which dry friction acts as a damper


class BatchDrives:
    """
    N robots' drives, [N, 12] each.

    Gear friction is handed to the rigid bodies as a damper that has the friction's torque at the
    present speed; MuJoCo steps dampers implicitly, so it neither chatters nor feeds energy in.
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
        self._limit = p['torque_limit']
        self.inertia = vary(p['rotor_inertia'] * effects.rotor_inertia.scale, spread.inertia)
        spring = effects.spring
        softer = np.ones(12)
        if spring.enabled:
            stiffness = p['spring_stiffness'] / max(spring.strength, 1e-3)
            softer = stiffness / (stiffness + POSITION_GAIN)
        self._stiffness = vary(POSITION_GAIN * softer, spread.stiffness)
        self._damping = vary(VELOCITY_GAIN * softer, spread.stiffness)
        self._timestep = timestep
        self._delay = np.rint(random.uniform(0.0, spread.delay, count) / timestep).astype(int)
        self.target = np.zeros((count, 12))
        self._next = np.zeros((count, 12))
        self._age = 0
        self._motor = np.zeros((count, 12))
        self._drag = np.zeros((count, 12))

    def start(self, ids: NDArray[np.intp], pose: Floats) -> None:
        """Some drives hold a pose, rad [len(ids), 12]."""
        self.target[ids] = pose
        self._next[ids] = pose

    def aim(self, targets: Floats) -> None:
        """Send new targets, rad; each robot's drives act on them after their delay."""
        self._next[:] = targets
        self._age = 0

    def push(self, position: Floats, velocity: Floats) -> tuple[Floats, Floats]:
        """Torque of the motors, N·m, and damping by friction, N·m·s/rad, for one time step."""
        arrived = self._delay <= self._age
        self.target[arrived] = self._next[arrived]
        self._age += 1
        motor = self._stiffness * (self.target - position) - self._damping * velocity
        np.clip(motor, -self._limit, self._limit, out=motor)
        speed = np.abs(velocity)
        slow = 1.0 + np.square(speed * self._fade)
        dry = self._coulomb + self._stribeck / (slow * slow) + self._load * np.abs(motor)
        self._motor = motor
        self._drag = self._viscous + dry / (speed + _SETTLING)
        return motor, self._drag

    def output(self, before: Floats, after: Floats) -> Floats:
        """
        Torque that the drives handed to the joints in the last time step, N·m.

        Motor less friction less what the rotor's inertia took; speeds are before and after, rad/s.
        """
        rotor = self.inertia * (after - before) / self._timestep
        return self._motor - self._drag * after - rotor
