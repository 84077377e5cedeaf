"""Drives of N robots at the time step of training: the simulator's own, in steps of 1 ms."""

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from sim_bridge.plant.drive import Drives, JointCommand
from sim_bridge.plant.parameters import Plant
from wattwalk_core.anymal import JOINT_NAMES
from wattwalk_core.arrays import Floats

from policy_training.config import RandomConfig

_STEP: Final = 0.001  # s; at the simulator's 0.5 ms drives take a fifth of training, not a tenth
_LIGHTEST: Final = 0.02  # kg·m², of a rotor behind _RIGID; robots with one of 0.005 are thrown
_RIGID: Final = 4000.0  # N·m/rad, of a drive without a spring


class BatchDrives:
    """N robots' drives, [N, 12] each.

    What a spring hands to its joint in a time step depends on where the joint goes meanwhile.
    The part of its torque that grows with the joint's speed is therefore left to the rigid
    bodies as `joint_damping`, which MuJoCo steps implicitly: so the two neither chatter nor feed
    energy in, though the step is long for a light shank on a spring of up to some 400 N·m/rad. A
    drive without a spring has a stiff one here, which may ring, and dies down.
    """

    def __init__(
        self,
        plant: Plant,
        count: int,
        timestep: float,
        spread: RandomConfig,
        random: np.random.Generator,
    ) -> None:
        shape = (count, 12)

        def vary(values: Floats | float, width: float) -> Floats:
            return np.asarray(values * random.uniform(1.0 - width, 1.0 + width, shape))

        p = plant.resolve(JOINT_NAMES)
        if not plant.effects.spring.enabled:
            inertia = p['rotor_inertia'] * plant.effects.rotor_inertia.scale
            p |= {
                'spring_stiffness': np.full(12, _RIGID),
                'rotor_inertia': np.maximum(inertia, _LIGHTEST),
            }
            plant = plant.with_effects(spring=True, rotor_inertia=True)
        rub = spread.drive_friction
        widths = dict.fromkeys(('coulomb', 'stribeck', 'viscous', 'load_friction'), rub)
        widths |= {'rotor_inertia': spread.inertia, 'loop_bandwidth': spread.torque_loop}
        widths |= {'output_viscous': spread.output, 'output_inertia': spread.output}
        p = {
            name: vary(values, widths[name]) if name in widths else np.tile(values, (count, 1))
            for name, values in p.items()
        }
        self.output_inertia = p['output_inertia']
        self._substeps = max(1, round(timestep / _STEP))
        self._step = timestep / self._substeps
        drives = self._drives = Drives(
            replace(plant, command_delay=0.0),
            JOINT_NAMES * count,
            self._step,
            1,
            {name: values.ravel() for name, values in p.items()},
        )
        drives.gains = tuple(vary(gain, spread.stiffness).ravel() for gain in drives.gains)
        soonest, latest = plant.command_delay + spread.delay * np.array([-1.0, 1.0])
        delay = random.uniform(max(soonest, 0.0), latest, count)
        self._delay = np.rint(delay / timestep).astype(int)
        self.output_damping: Floats = drives.output_damping.reshape(shape)
        self._spring = drives.stiffness.reshape(shape)
        self._damper = drives.damping.reshape(shape)
        self.joint_damping: Floats = self._damper + 0.5 * timestep * self._spring
        self.target = np.zeros(shape)
        self.commanded = np.zeros(shape)
        self._sent = np.zeros((int(self._delay.max(initial=0)) + 1, *shape))
        self._steps = 0
        self._given: Floats = np.zeros(shape)
        self.rotor_speed: Floats = np.zeros(shape)
        """Mean of the last time step, rad/s, in turns of the joint."""

    def start(self, ids: NDArray[np.intp], pose: Floats) -> None:
        """Reset the drives of some robots to rest in a pose, rad [len(ids), 12]."""
        self.target[ids] = pose
        self.commanded[ids] = pose
        self._sent[:, ids] = pose
        which = 12 * np.asarray(ids)[:, None] + np.arange(12)
        self._drives.reset(np.ravel(pose), which.ravel())

    def aim(self, targets: Floats) -> None:
        """Send targets, rad, which each robot's drives follow after their delay."""
        self.commanded[:] = targets

    def push(self, position: Floats, velocity: Floats) -> tuple[Floats, Floats]:
        """Advance the rotors by one time step, with joints at positions, rad, and speeds, rad/s.

        Returns the mean torque of the motors and, less what `joint_damping` makes of the joint's
        speed after the step, that on the joints, both N·m.
        """
        self._sent[self._steps % len(self._sent)] = self.commanded
        arrived = (self._steps - self._delay) % len(self._sent)
        self.target[:] = self._sent[arrived, np.arange(len(arrived))]
        self._steps += 1
        drives, out = self._drives, np.empty(position.size)
        drives.hold(JointCommand(position=self.target.ravel()))
        joint, speed = position.ravel(), np.ascontiguousarray(velocity).ravel()
        motor, turned, turning = (np.zeros(position.size) for _ in range(3))
        for index in range(self._substeps):
            drives.step(0, joint + speed * (self._step * index), speed, out)
            motor += drives.trace.motor[0]
            turned += drives.rotor
            turning += 0.5 * (drives.trace.velocity[0] + drives.rotor_velocity)
        share = 1.0 / self._substeps
        self.rotor_speed = (turning * share).reshape(position.shape)
        rotor = (turned * share).reshape(position.shape) - 0.5 * self._step * self.rotor_speed
        self._given = self._spring * (rotor - position) + self._damper * self.rotor_speed
        return (motor * share).reshape(position.shape), self._given

    def output(self, after: Floats) -> Floats:
        """Return the joint torque of the last time step, N·m, given the speeds after it, rad/s."""
        return self._given - self.joint_damping * after
