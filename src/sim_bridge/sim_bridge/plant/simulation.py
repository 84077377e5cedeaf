"""Simulation of rigid bodies, drives, circuit and bus in steps of 0.5 ms."""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, fields, replace
from typing import Final

import mujoco
import numpy as np
from wattwalk_core.anymal import FOOT_NAMES
from wattwalk_core.arrays import Floats

from sim_bridge.plant.circuit import Bus, Circuit
from sim_bridge.plant.drive import Drives, JointCommand
from sim_bridge.plant.parameters import Plant
from sim_bridge.plant.world import World

STEP: Final = 0.0005  # s
JOINT_PERIOD: Final = 5  # steps between joint samples: 400 Hz
LATCH: Final = 20  # steps between the drives' readings of bus voltage and temperature
PUSH_STEPS: Final = 200  # a push lasts 0.1 s


@dataclass(frozen=True)
class PlantBlock:
    """B steps of the plant: states at the end of each step, powers as its mean.

    base is NaN on a stand.
    """

    first: int  # index of the first step, counted from 0
    position: Floats  # rad [B, D]
    velocity: Floats  # rad/s [B, D]
    torque: Floats  # N·m [B, D], on the joint's output side
    voltage: Floats  # V [B], at the power meter
    power: Floats  # W [B, D], at the power meter
    supply_current: Floats  # A [B], drives only
    temperature: Floats  # °C [D], windings
    base: Floats  # [B, 13]: position, quaternion w x y z, velocity (world), rate (base)
    acceleration: Floats  # m/s² [B, 3], of the base, in the world
    foot_force: Floats  # N [B // 5 or one more, 4], where the step's index + 1 is a multiple of 5

    @property
    def steps(self) -> int:
        """Number of steps B."""
        return len(self.position)

    @classmethod
    def join(cls, blocks: Sequence['PlantBlock']) -> 'PlantBlock':
        """Join consecutive blocks; the temperature is that of the last."""
        stacked = {
            item.name: np.concatenate([getattr(block, item.name) for block in blocks])
            for item in fields(cls)
            if item.name not in ('first', 'temperature')
        }
        return cls(first=blocks[0].first, temperature=blocks[-1].temperature, **stacked)

    @property
    def current(self) -> Floats:
        """Current at the power meter, A [B, D]."""
        return self.power / self.voltage[:, None]


class Simulation:
    """Simulation of a plant that moves a world, in blocks of steps.

    Results do not depend on how a run is cut into blocks.
    """

    capacity = 400  # steps of a block at most

    def __init__(self, plant: Plant, world: World) -> None:
        """Make a simulation; InputError for an unknown type of drive."""
        self.plant = plant
        self.world = replace(world, model=copy(world.model))
        self.steps = 0
        capacity, joints = self.capacity, len(world.joints)
        self.drives = Drives(plant, world.joints, STEP, capacity)
        self.circuit = Circuit(plant, world.joints, self.drives.parameters)
        self.bus = Bus(plant, self.drives.parameters, STEP)
        model = self.world.model
        model.dof_armature[-joints:] = self.drives.armature
        model.dof_damping[-joints:] = self.drives.output_damping
        self._data = mujoco.MjData(model)
        mujoco.mj_setConst(model, self._data)
        self._qpos = np.zeros((capacity + 1, model.nq))
        self._qvel = np.zeros((capacity + 1, model.nv))
        self._torque, self._power = (np.zeros((capacity, joints)) for _ in range(2))
        self._voltage, self._supply = np.zeros(capacity), np.zeros(capacity)
        self._feet: list[Floats] = []
        self._latched = self.bus.voltage
        self._push_steps = 0
        self._push_force = np.zeros(3)
        self.reset()

    @property
    def time(self) -> float:
        """Time since the start, s."""
        return self.steps * STEP

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the D drives."""
        return self.world.joints

    @property
    def joint_position(self) -> Floats:
        """Present joint positions, rad [D]."""
        return np.array(self._data.qpos[-len(self.joints) :])

    @property
    def joint_velocity(self) -> Floats:
        """Present joint velocities, rad/s [D]."""
        return np.array(self._data.qvel[-len(self.joints) :])

    @property
    def base(self) -> Floats:
        """Base position (world, m), quaternion w x y z, velocity (world), rate (base); [13]."""
        return np.concatenate((self._data.qpos[:7], self._data.qvel[:6]))

    @property
    def fallen(self) -> str | None:
        """Reason why the robot has fallen, in a few words, or None."""
        if not self.world.floating:
            return None
        data = self._data
        upright = 1.0 - 2.0 * (data.qpos[4] ** 2 + data.qpos[5] ** 2)
        if upright < 0.5:
            return f'tilted by {np.degrees(np.arccos(np.clip(upright, -1.0, 1.0))):.0f} degrees'
        height = float(data.qpos[2] - min(data.site(name).xpos[2] for name in FOOT_NAMES))
        return f'base only {height:.2f} m above the feet' if height < 0.25 else None

    def reset(self) -> None:
        """Reset the robot's pose; time, temperatures and bus voltage continue."""
        data = self._data
        mujoco.mj_resetData(self.world.model, data)
        data.qpos[:] = self.world.start
        mujoco.mj_forward(self.world.model, data)
        self._push_steps = 0
        self.drives.reset(self.joint_position)

    def hold(self, command: JointCommand) -> None:
        """Set the command that the drives hold until the next one."""
        self.drives.hold(command)

    def push(self, velocity: Floats) -> None:
        """Push the base for 0.1 s with the impulse that gives the robot a velocity, m/s [3]."""
        self._push_force = self.world.mass * np.asarray(velocity) / (PUSH_STEPS * STEP)
        self._push_steps = PUSH_STEPS

    def advance(self, steps: int) -> PlantBlock:
        """Run 1 to `capacity` steps and return them as a block; ValueError for other numbers."""
        if not 0 < steps <= self.capacity:
            raise ValueError(f'a block has 1..{self.capacity} steps, not {steps}')
        first = self.steps
        self._feet = []
        row = 0
        while row < steps:
            stop = min(steps, row + LATCH - self.steps % LATCH)
            if self._push_steps:
                stop = min(stop, row + self._push_steps)
            self._run(row, stop)
            row = stop
        return self._block(first, steps)

    def _run(self, start: int, stop: int) -> None:
        if self.steps % LATCH == 0:
            self.drives.set_voltage(self.bus.voltage)
            if self.steps:
                self.circuit.temperature.settle(STEP, LATCH)
            self._latched = self.bus.voltage
        if self._push_steps:
            self._data.xfrc_applied[1, :3] = self._push_force
        self._move(start, stop)
        if self._push_steps:
            self._push_steps -= stop - start
            self._data.xfrc_applied[1, :3] = 0.0
        self._draw(slice(start, stop))

    def _move(self, start: int, stop: int) -> None:
        data, model, drives, feet = self._data, self.world.model, self.drives, self.world.feet
        count = len(self.joints)
        position, velocity, control = data.qpos[-count:], data.qvel[-count:], data.ctrl
        all_position, all_velocity = data.qpos, data.qvel
        qpos, qvel = self._qpos, self._qvel
        due = JOINT_PERIOD - self.steps % JOINT_PERIOD
        for row in range(start, stop):
            qpos[row] = all_position
            qvel[row] = all_velocity
            drives.step(row, position, velocity, control)
            mujoco.mj_step(model, data)
            due -= 1
            if due == 0:
                due = JOINT_PERIOD
                if feet is not None:
                    self._feet.append(feet(data))
        qpos[stop] = all_position
        qvel[stop] = all_velocity
        self.steps += stop - start

    def _draw(self, rows: slice) -> None:
        drives, trace = self.drives, self.drives.trace
        _, rotor_speed, acceleration = self._rates(rows)
        torque = trace.output[rows]
        self._torque[rows] = torque if drives.elastic else torque - drives.inertia * acceleration
        time = STEP * np.arange(self.steps - rows.stop + rows.start + 1, self.steps + 1)
        self.flow = self.circuit.solve(
            trace.motor[rows], rotor_speed, trace.drag[rows], self._latched, time
        )
        self.bus_flow = self.bus.solve(self.flow.link)
        self._power[rows] = self.bus_flow.power
        self._voltage[rows] = self.bus_flow.voltage
        self._supply[rows] = self.bus_flow.supply_current

    def _rates(self, rows: slice) -> tuple[Floats, Floats, Floats]:
        """Return mean joint and rotor speeds, rad/s, and rotor accelerations, rad/s² [B, D]."""
        joints = self._qvel[rows.start : rows.stop + 1, -len(self.joints) :]
        speed = 0.5 * (joints[:-1] + joints[1:])
        if not self.drives.elastic:
            return speed, speed, (joints[1:] - joints[:-1]) / STEP
        before = self.drives.trace.velocity[rows]
        after = np.vstack((before[1:], self.drives.rotor_velocity))
        return speed, 0.5 * (before + after), (after - before) / STEP

    def _block(self, first: int, steps: int) -> PlantBlock:
        count = len(self.joints)
        qpos, qvel = self._qpos[1 : steps + 1], self._qvel[: steps + 1]
        if self.world.floating:
            base = np.hstack((qpos[:, :7], qvel[1:, :6]))
            acceleration = (qvel[1:, :3] - qvel[:-1, :3]) / STEP
        else:
            base = np.full((steps, 13), np.nan)
            acceleration = np.full((steps, 3), np.nan)
        feet = np.array(self._feet) if self._feet else np.zeros((0, 4))
        return PlantBlock(
            first=first,
            position=qpos[:, -count:].copy(),
            velocity=qvel[1:, -count:].copy(),
            torque=self._torque[:steps].copy(),
            voltage=self._voltage[:steps].copy(),
            power=self._power[:steps].copy(),
            supply_current=self._supply[:steps].copy(),
            temperature=self.circuit.temperature.winding.copy(),
            base=base,
            acceleration=acceleration,
            foot_force=feet,
        )
