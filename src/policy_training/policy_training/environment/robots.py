"""N simulated robots on one terrain, stepped in threads."""

from dataclasses import dataclass, replace
from typing import Final

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray
from policy_runner.policies.trot import TARGET_LIMITS
from scipy.ndimage import maximum_filter
from sim_bridge.plant.anymal_model import build_spec
from sim_bridge.plant.drive import Drives, JointCommand
from sim_bridge.plant.parameters import Plant
from sim_bridge.plant.terrain import Terrain
from sim_bridge.sensors.sensors import into_base
from wattwalk_core.anymal import DEFAULT_POSE, FOOT_NAMES, JOINT_NAMES, LEGS, STANDING_HEIGHT
from wattwalk_core.arrays import Bools, Floats

from policy_training.config import PhysicsConfig, RandomConfig

_STEP: Final = 0.001  # s; at the simulator's 0.5 ms drives take a fifth of training, not a tenth
_LIGHTEST: Final = 0.02  # kg·m², of a rotor behind _RIGID; robots with one of 0.005 are thrown
_RIGID: Final = 4000.0  # N·m/rad, of a drive without a spring


class BatchDrives:
    """Drives of N robots; arrays are [N, 12].

    What a spring hands to its joint in a time step depends on where the joint goes meanwhile. The
    part of its torque that grows with the joint's speed is therefore left to the rigid bodies as
    `joint_damping`, which MuJoCo steps implicitly: so the two neither chatter nor feed energy in,
    though the step is long for a light shank on a spring of up to some 400 N·m/rad. A drive
    without a spring has a stiff one here, which may ring, and dies down.
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
            p['spring_stiffness'] = np.full(12, _RIGID)
            p['rotor_inertia'] = np.maximum(inertia, _LIGHTEST)
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
        prompt = replace(plant, command_delay=0.0)
        flat = {name: values.ravel() for name, values in p.items()}
        drives = self._drives = Drives(prompt, JOINT_NAMES * count, self._step, 1, flat)
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
        """Send targets, rad [N, 12], which each robot's drives follow after their delay."""
        self.commanded[:] = targets

    def push(self, position: Floats, velocity: Floats) -> tuple[Floats, Floats]:
        """Advance the rotors by one time step; joints are at positions, rad, and speeds, rad/s.

        Arrays are [N, 12]. Returns two torques in N·m: the motors' mean, and the joints' without
        the part that the rigid bodies add, −`joint_damping` times the joint speed after the step.
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
        """Return joint torques of the last step, N·m [N, 12], given the speeds after it, rad/s."""
        return self._given - self.joint_damping * after


_RIM: Final = 8.0  # m of the ground's edge where nobody starts
_NEAR: Final = 0.8  # m, edge of the patch whose highest point a robot is put above


def add_planes(spec: mujoco.MjSpec, friction: float) -> None:
    """Add a plane for each foot that collides with it alone, in place of the floor."""
    for index, foot in enumerate(FOOT_NAMES):
        own = 2 << index
        spec.geom(foot).conaffinity = own
        spec.worldbody.add_geom(
            name=f'{foot}_ground',
            type=mujoco.mjtGeom.mjGEOM_PLANE,
            pos=[0, 0, -1.0],
            quat=[0.8, 0.6, 0, 0],
            size=[0, 0, 1],
            contype=own,
            conaffinity=0,
            friction=[friction, 0.005, 0.0001],
        )


class Ground:
    """Planes under the feet of all robots, which `follow` moves with the feet."""

    def __init__(self, terrain: Terrain, model: mujoco.MjModel, batch: Batch) -> None:
        self.relief = Relief(terrain)
        self._planes = [model.geom(f'{foot}_ground').id for foot in FOOT_NAMES]
        self._floor = model.geom('floor').id
        self._position = batch.expand('geom_pos')
        self._attitude = batch.expand('geom_quat')

    def follow(self, soles: Floats) -> None:
        """Move the planes to feet, m [N, 4, 3] in the world."""
        height, slope = self.relief.at(soles[..., :2])
        self._position[:, self._planes, :2] = soles[..., :2]
        self._position[:, self._planes, 2] = height
        self._position[:, self._floor, 2] = height.min(axis=1)
        # The rotation that takes z to (−∂h/∂x, −∂h/∂y, 1), by half angles.
        long = np.sqrt(1.0 + np.square(slope).sum(axis=-1))
        half = np.sqrt(0.5 * (1.0 + 1.0 / long))
        scale = 0.5 / (half * long)
        self._attitude[:, self._planes, 0] = half
        self._attitude[:, self._planes, 1] = slope[..., 1] * scale
        self._attitude[:, self._planes, 2] = -slope[..., 0] * scale
        self._attitude[:, self._planes, 3] = 0.0


class Relief:
    """Heights and slopes of a terrain at any place."""

    def __init__(self, terrain: Terrain) -> None:
        self._heights = np.zeros((3, 3)) if terrain.is_flat else terrain.heights()
        self._half = terrain.extent / 2
        self._cells = len(self._heights) - 1
        self._cell = terrain.extent / self._cells
        self._highest = maximum_filter(self._heights, size=round(_NEAR / self._cell) | 1)
        self.reach = self._half - _RIM

    def at(self, where: Floats) -> tuple[Floats, Floats]:
        """Return height, m [...], and slope along x and y [..., 2] at places x, y in m [..., 2].

        Each cell is two triangles that meet between its corners at low x, low y and at high x,
        high y, as in MuJoCo's height fields.
        """
        place = np.clip((where + self._half) / self._cell, 0.0, self._cells - 1e-9)
        index = place.astype(np.intp)
        column, row = index[..., 0], index[..., 1]
        u, v = np.moveaxis(place - index, -1, 0)
        low, high = self._heights[row, column], self._heights[row + 1, column + 1]
        upper = v > u
        corner = np.where(upper, self._heights[row + 1, column], self._heights[row, column + 1])
        along_x = np.where(upper, high - corner, corner - low)
        along_y = np.where(upper, corner - low, high - corner)
        slope = np.stack([along_x, along_y], axis=-1) / self._cell
        return low + along_x * u + along_y * v, slope

    def above(self, where: Floats) -> Floats:
        """Return the highest ground near places x, y in m [N, 2], m [N]."""
        index = np.rint((where + self._half) / self._cell).astype(np.intp)
        column, row = np.clip(index, 0, self._cells).T
        return np.asarray(self._highest[row, column])


_NEEDLESS: Final = mujoco.mjtDisableBit.mjDSBL_MIDPHASE | mujoco.mjtDisableBit.mjDSBL_ISLAND
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
    torque: Floats  # N·m [N, 12], on the joints, rms over the step
    foot_force: Floats  # N [N, 4], upwards
    collisions: Floats  # thighs and shanks on the ground [N]
    fallen: Bools  # [N]


@dataclass(frozen=True)
class Substep:
    """Signals of the drives of N robots in one time step, [N, 12] each."""

    position_error: Floats  # rad, target as sent minus position, as recordings have it
    torque: Floats  # N·m, on the joint's side of the drive
    velocity: Floats  # rad/s
    motor: Floats  # N·m, air gap
    rotor_speed: Floats  # rad/s, mean of the step, in turns of the joint


class Robots:
    """N simulated robots.

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
        # neither changes the motion: one robot is one island, and few of its bodies ever touch
        spec.option.disableflags |= _NEEDLESS
        model = spec.compile()
        batch = self._batch = Batch(model, count, physics.threads)
        batch.expand('dof_damping')[:, 6:] = self.drives.joint_damping + self.drives.output_damping
        batch.expand('dof_armature')[:, 6:] = self.drives.output_inertia
        self._ground = Ground(terrain, model, batch)
        batch.expand('geom_friction')[..., 0] = random.uniform(
            spread.friction_low, spread.friction_high, (count, 1)
        )
        mass = batch.expand('body_mass')
        mass[:, 1] += random.uniform(-spread.payload, spread.payload, count)
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

    def start(self, ids: NDArray[np.intp]) -> None:
        """Place the robots of these indices at random, standing or moving in a random pose."""
        random, spread, count = self._random, self._spread, len(ids)
        rough = (random.random(count) >= spread.resting)[:, None]
        bent, moving = spread.pose * rough, spread.velocity * rough
        pose = DEFAULT_POSE * random.uniform(1 - bent, 1 + bent, (count, 12))
        relief = self._ground.relief
        where = random.uniform(-relief.reach, relief.reach, (count, 2))
        heading = random.uniform(-np.pi, np.pi, count)
        self._qpos[ids, :2] = where
        drop = np.where(rough[:, 0], _DROP, 0.0)
        self._qpos[ids, 2] = relief.above(where) + STANDING_HEIGHT + drop
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

    def push(self, ids: NDArray[np.intp]) -> None:
        """Add random horizontal velocities to robots by index."""
        most = self._spread.push
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
            output = drives.output(velocity)
            squares += output * output
            signals = Substep(
                position_error=drives.commanded - position,
                torque=output,
                velocity=velocity.copy(),
                motor=motor,
                rotor_speed=drives.rotor_speed,
            )
            self.substeps.append(signals)
        return self.motion(np.sqrt(squares / self.decimation))

    def motion(self, torque: Floats | None = None) -> RobotMotion:
        """Return the present state; torque: N·m [N, 12], as in RobotMotion, 0 if None."""
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
