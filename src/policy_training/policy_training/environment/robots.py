"""N simulated robots on one terrain, stepped in threads."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray
from policy_runner.policies.trot import TARGET_LIMITS
from sim_bridge.plant.anymal_model import build_spec
from sim_bridge.plant.parameters import Plant
from sim_bridge.plant.terrain import Terrain
from sim_bridge.sensors.sensors import into_base
from wattwalk_core.anymal import DEFAULT_POSE, FOOT_NAMES, LEGS, STANDING_HEIGHT

from policy_training.config import PhysicsConfig, RandomConfig
from policy_training.environment.drives import BatchDrives
from policy_training.environment.ground import Ground, add_planes

Floats = NDArray[np.float64]
Marks = NDArray[np.bool_]

_DOWN: Final = np.array([0.0, 0.0, -1.0])
_LIMBS: Final = tuple(f'{leg}_{part}' for leg in LEGS for part in ('THIGH', 'SHANK'))
_MOST_TILT: Final = 1.0  # rad
_LEAST_HEIGHT: Final = 0.25  # m, base over the lowest foot
_DROP: Final = 0.04  # m, that a start in motion is put above the ground


@dataclass(frozen=True)
class RobotMotion:
    """State of N robots after a policy step."""

    velocity: Floats  # m/s [N, 3], base frame
    rate: Floats  # rad/s [N, 3], base frame
    gravity: Floats  # unit vector [N, 3], base frame
    position: Floats  # rad [N, 12]
    joint_velocity: Floats  # rad/s [N, 12]
    torque: Floats  # N·m [N, 12], of the motors, mean of squares over the step, rooted
    foot_force: Floats  # N [N, 4], upwards
    collisions: NDArray[np.float64]  # thighs and shanks on the ground [N]
    fallen: Marks  # [N]


@dataclass(frozen=True)
class Substep:
    """Signals of the drives of N robots in one time step, [N, 12] each."""

    position_error: Floats  # rad, target in force minus position
    torque: Floats  # N·m, on the joint's side of the drive
    velocity: Floats  # rad/s
    motor: Floats  # N·m, air gap
    rotor_speed: Floats  # rad/s, mean of the step, in turns of the joint


class Robots:
    """
    N simulated robots.

    Friction of the ground, payload, and rotors and friction of the drives are drawn once for each
    robot; its initial state is drawn at each start. substeps: signals of the drives in the time
    steps of the last policy step.
    """

    def __init__(
        self, physics: PhysicsConfig, spread: RandomConfig, random: np.random.Generator
    ) -> None:
        count = physics.environments
        self.count = count
        self.decimation = physics.decimation
        self._random = random
        self._spread = spread
        terrain = Terrain(
            noise=physics.noise,
            slope=physics.slope,
            extent=physics.extent,
            seed=int(random.integers(2**31)),
        )
        plant = Plant.load(physics.plant)
        self.drives = BatchDrives(plant, count, physics.timestep, spread, random)
        spec = build_spec(armature=0.0, timestep=physics.timestep, contact_sensors=True)
        add_planes(spec, friction=1.0)
        if physics.contacts == 'feet_and_base':
            for geom in spec.geoms:
                if geom.name in _LIMBS or geom.name.endswith('_HIP'):
                    geom.conaffinity = 0
        model = spec.compile()
        model.dof_damping[6:] = self.drives.joint_damping
        batch = self._batch = Batch(model, count, physics.threads)
        self._ground = Ground(terrain, model, batch)
        batch.expand('geom_friction')[..., 0] = random.uniform(
            spread.friction_low, spread.friction_high, (count, 1)
        )
        payload = random.uniform(-spread.payload, spread.payload, count)
        mass = batch.expand('body_mass')
        mass[:, 1] += payload
        batch.set_const()
        self.mass: Floats = mass.sum(axis=1)
        self._qpos, self._qvel = batch.bind('qpos'), batch.bind('qvel')
        self._control, self._warm = batch.bind('ctrl'), batch.bind('qacc_warmstart')
        self._sensors = batch.bind('sensordata')
        self._soles = batch.bind('site_xpos')
        self._sole_ids = [model.site(name).id for name in FOOT_NAMES]
        self._feet = [model.sensor(name).adr[0] + 2 for name in FOOT_NAMES]
        self._limbs = [model.sensor(name).adr[0] for name in _LIMBS]
        self._belly = model.sensor('base').adr[0]
        self.substeps: list[Substep] = []
        batch.reset(keyframe=0)

    @property
    def base_position(self) -> Floats:
        """Positions of the bases in the world, m [N, 3]."""
        position: Floats = self._qpos[:, :3]
        return position

    def start(self, ids: NDArray[np.intp]) -> None:
        """Place the robots of these indices at random, standing or moving in a random pose."""
        random, spread, count = self._random, self._spread, len(ids)
        rough = (random.random(count) >= spread.resting)[:, None]
        bent, moving = spread.pose * rough, spread.velocity * rough
        pose = DEFAULT_POSE * random.uniform(1 - bent, 1 + bent, (count, 12))
        where = random.uniform(-self._ground.relief.reach, self._ground.relief.reach, (count, 2))
        heading = random.uniform(-np.pi, np.pi, count)
        self._qpos[ids, :2] = where
        drop = np.where(rough[:, 0], _DROP, 0.0)
        self._qpos[ids, 2] = self._ground.relief.above(where) + STANDING_HEIGHT + drop
        self._qpos[ids, 3:7] = 0.0
        self._qpos[ids, 3], self._qpos[ids, 6] = np.cos(heading / 2), np.sin(heading / 2)
        self._qpos[ids, 7:] = pose
        self._qvel[ids] = 0.0
        self._qvel[ids, :6] = random.uniform(-moving, moving, (count, 6))
        self._warm[ids] = 0.0
        self.drives.start(ids, pose)
        self._batch.forward(ids=np.sort(ids))
        self._ground.follow(self._soles[:, self._sole_ids])
        self._batch.forward(ids=np.sort(ids))

    def push(self, ids: NDArray[np.intp], share: float = 1.0) -> None:
        """Add random horizontal velocities, a share of the spread's, to robots by index."""
        most = share * self._spread.push
        self._qvel[ids, :2] += self._random.uniform(-most, most, (len(ids), 2))

    def step(self, targets: Floats) -> RobotMotion:
        """Simulate one policy step with joint targets, rad [N, 12]; return the motion."""
        drives, position, velocity = self.drives, self._qpos[:, 7:], self._qvel[:, 6:]
        self.substeps = []
        drives.aim(np.clip(targets, TARGET_LIMITS[:, 0], TARGET_LIMITS[:, 1]))
        squares = np.zeros((self.count, 12))
        for _ in range(self.decimation):
            motor, self._control[:] = drives.push(position, velocity)
            self._ground.follow(self._soles[:, self._sole_ids])
            self._batch.step()
            squares += motor * motor
            self.substeps.append(
                Substep(
                    position_error=drives.target - position,
                    torque=drives.output(velocity),
                    velocity=velocity.copy(),
                    motor=motor,
                    rotor_speed=drives.rotor_speed,
                )
            )
        return self.motion(np.sqrt(squares / self.decimation))

    def motion(self, torque: Floats | None = None) -> RobotMotion:
        """Return the present state; torque: as in RobotMotion, 0 if None."""
        qpos, qvel = self._qpos, self._qvel
        attitude = qpos[:, 3:7]
        gravity = into_base(attitude, np.broadcast_to(_DOWN, (self.count, 3)))
        lowest = self._soles[:, self._sole_ids, 2].min(axis=1)
        wrong = ~np.isfinite(qpos).all(axis=1) | ~np.isfinite(qvel).all(axis=1)
        return RobotMotion(
            velocity=into_base(attitude, qvel[:, :3]),
            rate=qvel[:, 3:6].copy(),
            gravity=gravity,
            position=qpos[:, 7:].copy(),
            joint_velocity=qvel[:, 6:].copy(),
            torque=np.zeros((self.count, 12)) if torque is None else torque,
            foot_force=np.abs(self._sensors[:, self._feet]),
            collisions=(self._sensors[:, self._limbs] > 0).sum(axis=1).astype(np.float64),
            fallen=wrong
            | (self._sensors[:, self._belly] > 0)
            | (gravity[:, 2] > -np.cos(_MOST_TILT))
            | (qpos[:, 2] - lowest < _LEAST_HEIGHT),
        )
