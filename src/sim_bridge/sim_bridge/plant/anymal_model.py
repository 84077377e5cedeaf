"""ANYmal C as a MuJoCo model with one ideal torque source per joint.

Inertias are those of the manufacturer's URDF, with every frame aligned to the base. Friction and
damping are absent here: they belong to the drives.
"""

from typing import Final

import mujoco
import numpy as np
from wattwalk_core.anymal import FOOT_NAMES, JOINT_NAMES, LEGS, STANDING_HEIGHT
from wattwalk_core.arrays import Floats

from sim_bridge.plant.drive_steps import foot_force
from sim_bridge.plant.terrain import FLAT, Terrain
from wattwalk_core import anymal

TIMESTEP: Final = 0.0005  # s
ARMATURE: Final = 0.0675  # kg·m², mean of the drives fitted in arXiv 2509.06342
FRICTION: Final = 1.0  # of feet and limbs on the ground, sliding

_NET_FORCE: Final = 3  # reduction of a contact sensor: sum of all contacts, world frame


_LINKS: Final = (
    (
        *('HIP', 'HAA', anymal.HIP_IN_BASE, anymal.HIP_MASS, anymal.HIP_CENTRE),
        (0.0033, 0.0049, 0.0058, 0.0, 0.00014),
    ),
    (
        *('THIGH', 'HFE', anymal.THIGH_IN_HIP, anymal.THIGH_MASS, anymal.THIGH_CENTRE),
        (0.0299, 0.0296, 0.0049, 0.0, 0.0041),
    ),
    (
        *('SHANK', 'KFE', anymal.SHANK_IN_THIGH, anymal.SHANK_MASS, anymal.SHANK_CENTRE),
        (0.0088, 0.0102, 0.0016, 0.0018, 0.0),
    ),
)
"""Links of LF: joint, origin in the parent, mass, centre and Ixx, Iyy, Izz, Ixz, Iyz (kg·m²)."""


def build_spec(
    terrain: Terrain = FLAT,
    *,
    armature: float = ARMATURE,
    payload: float = 0.0,
    friction: float = FRICTION,
    timestep: float = TIMESTEP,
    contact_sensors: bool = False,
) -> mujoco.MjSpec:
    """Return ANYmal C on a terrain, with a torque actuator per joint in JOINT_NAMES' order.

    armature: inertia of rotor and gears at the joint, kg·m². payload: kg added at the base's
    origin. friction: sliding, between robot and ground. Actuators neither limit nor dampen; the
    keyframe `default` stands in DEFAULT_POSE. Qpos [19] is base position, quaternion, joints.
    contact_sensors: add sensors by name of the geom: the contact force on each foot, N [3], and
    the number of contacts of base, hips, thighs and shanks.
    ValueError for a negative armature or timestep, or a payload below −10 kg.
    """
    if armature < 0.0 or timestep <= 0.0 or payload < -10.0 or friction < 0.0:
        raise ValueError(
            f'armature {armature!r} kg·m² and friction {friction!r} must not be negative, '
            f'timestep {timestep!r} s must be positive, payload {payload!r} kg at least -10'
        )
    spec = mujoco.MjSpec()
    spec.modelname = 'anymal_c'
    spec.compiler.degree = False
    _set_options(spec, timestep)
    _add_ground(spec, terrain)
    base = _add_base(spec, payload)
    for leg in LEGS:
        _add_leg(base, leg, armature)
    for joint in JOINT_NAMES:
        motor = spec.add_actuator(name=joint, target=joint)
        motor.trntype = mujoco.mjtTrn.mjTRN_JOINT
        motor.set_to_motor()
    for geom in spec.geoms:
        geom.friction[0] = friction  # the larger one of two that touch counts
    _add_sensors(spec)
    if contact_sensors:
        _add_contact_sensors(spec)
    standing = [0.0, 0.0, STANDING_HEIGHT, 1.0, 0.0, 0.0, 0.0, *anymal.DEFAULT_POSE]
    spec.add_key(name='default', qpos=standing)
    return spec


class FootForce:
    """Reader of the normal force on each foot of a simulation."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._foot = np.full(model.ngeom, len(FOOT_NAMES))
        for index, name in enumerate(FOOT_NAMES):
            self._foot[model.geom(name).id] = index

    def __call__(self, data: mujoco.MjData) -> Floats:
        """Return the ground's forces along the contact normals, N [4], of the last step."""
        contact, force = data.contact, np.zeros(len(FOOT_NAMES))
        foot_force(self._foot, contact.geom, contact.efc_address, data.efc_force, force)
        return force


def _set_options(spec: mujoco.MjSpec, timestep: float) -> None:
    option = spec.option
    option.timestep = timestep
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.noslip_iterations = 1
    option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE


def _add_ground(spec: mujoco.MjSpec, terrain: Terrain) -> None:
    world = spec.worldbody
    world.add_light(
        pos=[0, 0, 4], dir=[0.2, 0.2, -1], type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    )
    surface = {'contype': 1, 'conaffinity': 1, 'rgba': [0.55, 0.57, 0.55, 1.0]}
    floor = 0.0
    if not terrain.is_flat:
        heights = terrain.heights()
        floor = float(heights.min())
        rise = float(np.ptp(heights))
        half = terrain.extent / 2
        field = spec.add_hfield(name='terrain', nrow=len(heights), ncol=len(heights))
        field.size = [half, half, rise, 0.1]
        field.userdata = ((heights - floor) / rise).ravel()
        world.add_geom(
            name='terrain',
            type=mujoco.mjtGeom.mjGEOM_HFIELD,
            hfieldname='terrain',
            pos=[0, 0, floor],
            **surface,
        )
    world.add_geom(
        name='floor',
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        pos=[0, 0, floor],
        size=[0, 0, 1],
        **surface,
    )


def _add_base(spec: mujoco.MjSpec, payload: float) -> mujoco.MjsBody:
    mass = anymal.BASE_MASS + payload
    base = spec.worldbody.add_body(
        name='base',
        pos=[0, 0, STANDING_HEIGHT],
        mass=mass,
        ipos=anymal.BASE_CENTRE * anymal.BASE_MASS / mass,
        fullinertia=[0.2167, 1.7852, 1.8337, 0.0092, 0.0589, 0.0],
        explicitinertial=True,
    )
    base.add_freejoint(name='base')
    base.add_site(name='imu', pos=[0, 0, 0])
    _add_shell(base, 'base', mujoco.mjtGeom.mjGEOM_BOX, size=[0.32, 0.13, 0.11], pos=[0, 0, 0.02])
    return base


def _add_leg(base: mujoco.MjsBody, leg: str, armature: float) -> None:
    sx, sy = anymal.FRONT[LEGS.index(leg)], anymal.LEFT[LEGS.index(leg)]
    mirror = np.array([sx, sy, 1.0])
    knee, sole = anymal.SHANK_IN_THIGH * mirror, anymal.FOOT_IN_SHANK * mirror
    bodies = [base]
    for part, joint, origin, mass, centre, (xx, yy, zz, xz, yz) in _LINKS:
        body = bodies[-1].add_body(
            name=f'{leg}_{part}',
            pos=origin * mirror,
            mass=mass,
            ipos=centre * mirror,
            fullinertia=[xx, yy, zz, 0.0, xz * sx, yz * sy],
            explicitinertial=True,
        )
        body.add_joint(
            name=f'{leg}_{joint}',
            type=mujoco.mjtJoint.mjJNT_HINGE,
            axis=[1, 0, 0] if joint == 'HAA' else [0, 1, 0],
            limited=True,
            range=anymal.LIMITS[JOINT_NAMES.index(f'{leg}_{joint}')],
            armature=armature,
        )
        bodies.append(body)
    _, hip, thigh, shank = bodies
    sphere, capsule = mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_CAPSULE
    upper = [0.0, 0.04 * sy, 0.0, *(knee * (1, 0.7, 1))]
    lower = [0.0, 0.0, 0.0, *(0.85 * sole)]
    _add_shell(hip, f'{leg}_HIP', sphere, size=[0.08, 0, 0], pos=[0.06 * sx, 0, 0])
    _add_shell(thigh, f'{leg}_THIGH', capsule, size=[0.045, 0, 0], fromto=upper)
    _add_shell(shank, f'{leg}_SHANK', capsule, size=[0.022, 0, 0], fromto=lower)
    _add_shell(shank, f'{leg}_FOOT', sphere, size=[anymal.FOOT_RADIUS, 0, 0], pos=sole, dark=True)
    shank.add_site(name=f'{leg}_FOOT', pos=sole)


def _add_shell(
    body: mujoco.MjsBody, name: str, shape: mujoco.mjtGeom, *, dark: bool = False, **where: object
) -> None:
    body.add_geom(
        name=name,
        type=shape,
        contype=0,
        conaffinity=1,
        mass=0.0,
        rgba=[0.1, 0.1, 0.1, 1.0] if dark else [0.75, 0.15, 0.1, 1.0],
        **where,
    )


def _add_sensors(spec: mujoco.MjSpec) -> None:
    for name, kind in (
        ('imu_acceleration', mujoco.mjtSensor.mjSENS_ACCELEROMETER),
        ('imu_angular_velocity', mujoco.mjtSensor.mjSENS_GYRO),
        ('imu_orientation', mujoco.mjtSensor.mjSENS_FRAMEQUAT),
        ('base_velocity', mujoco.mjtSensor.mjSENS_VELOCIMETER),
    ):
        spec.add_sensor(name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname='imu')


def _add_contact_sensors(spec: mujoco.MjSpec) -> None:
    kinds = mujoco.mjtConDataField
    shells = ('base', *(f'{leg}_{part}' for leg in LEGS for part in ('HIP', 'THIGH', 'SHANK')))
    for name, kind in (
        *((foot, kinds.mjCONDATA_FORCE) for foot in FOOT_NAMES),
        *((shell, kinds.mjCONDATA_FOUND) for shell in shells),
    ):
        spec.add_sensor(
            name=name,
            type=mujoco.mjtSensor.mjSENS_CONTACT,
            objtype=mujoco.mjtObj.mjOBJ_GEOM,
            objname=name,
            intprm=[1 << kind.value, _NET_FORCE if name in FOOT_NAMES else 0, 1],
        )
