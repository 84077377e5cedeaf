"""Worlds that the drives move: the walking robot, or one drive on a stand."""

from dataclasses import dataclass
from typing import Annotated

import mujoco
import numpy as np
from wattwalk_core.anymal import JOINT_NAMES
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError
from wattwalk_core.schema import CheckedFields, Quantity

from sim_bridge.plant.anymal_model import TIMESTEP, FootForce, build_spec
from sim_bridge.plant.terrain import FLAT, Terrain


@dataclass(frozen=True)
class World:
    """A rigid-body model whose last joints are those of the drives, one actuator each in order.

    start: qpos at reset. feet: reader of the contact forces, or None on a stand.
    """

    model: mujoco.MjModel
    joints: tuple[str, ...]
    start: Floats
    feet: FootForce | None = None

    @property
    def floating(self) -> bool:
        """True with a base that moves freely."""
        return self.feet is not None

    @property
    def mass(self) -> float:
        """Mass of all bodies, kg."""
        return float(self.model.body_mass.sum())


def walking_world(terrain: Terrain = FLAT, payload: float = 0.0) -> World:
    """Return ANYmal C standing on a terrain; joints in the order of JOINT_NAMES.

    payload: kg, at the centre of the base's mass. InputError outside 0..50 kg.
    """
    if not 0.0 <= payload <= 50.0:
        raise InputError(f'payload is {payload:g}; it must lie in 0..50 kg')
    model = build_spec(terrain).compile()
    model.body_mass[1] += payload
    start: Floats = np.array(model.key('default').qpos, dtype=np.float64)
    return World(model, JOINT_NAMES, start, FootForce(model))


@dataclass(frozen=True)
class Stand(CheckedFields):
    """Load of one drive on a bench: a disc (inertia, kg·m²) and a pendulum (mass kg, length m).

    InputError for a negative mass, length or inertia, or less than 1e-4 kg·m² in all.
    """

    inertia: Annotated[float, Quantity(0.0, 100.0, 'kg·m²')] = 0.02
    mass: Annotated[float, Quantity(0.0, 100.0, 'kg')] = 0.0
    length: Annotated[float, Quantity(0.0, 100.0, 'm')] = 0.3

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.inertia + self.mass * self.length**2 < 1e-4:
            raise InputError(f'stand inertia is {self.inertia!r}; give at least 1e-4 kg·m²')


def stand_world(joint: str, stand: Stand | None = None) -> World:
    """Return one drive on a stand, hanging at 0 rad; positive angles swing it to the front."""
    load = Stand() if stand is None else stand
    spec = mujoco.MjSpec()
    spec.modelname = 'stand'
    spec.option.timestep = TIMESTEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    body = spec.worldbody.add_body(
        name='load',
        mass=load.mass + 1e-3,
        ipos=[0.0, 0.0, -load.length * load.mass / (load.mass + 1e-3)],
        inertia=[1e-5, load.inertia + 1e-5, load.inertia + 1e-5],
        explicitinertial=True,
    )
    body.add_joint(name=joint, type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, -1, 0])
    motor = spec.add_actuator(name=joint, target=joint)
    motor.trntype = mujoco.mjtTrn.mjTRN_JOINT
    motor.set_to_motor()
    return World(spec.compile(), (joint,), np.zeros(1))
