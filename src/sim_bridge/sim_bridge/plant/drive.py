"""Mechanical side of the drives: controller, limits, friction, rotor, cogging and spring."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.anymal import POSITION_GAIN, VELOCITY_GAIN
from wattwalk_core.arrays import Floats

from sim_bridge.plant.drive_steps import drive_step
from sim_bridge.plant.parameters import Plant

SPEED_MODE_GAIN: Final = 15.0  # N·m·s/rad
_LINK_INERTIA: Final = 0.012  # kg·m², the least that hangs on a joint of a leg
_ALL: Final = slice(None)
_STABLE: Final = 0.8  # share of the inertia that dry friction may stop within a step


@dataclass(frozen=True)
class JointCommand:
    """Command that the drives hold until the next one, each [D] or None.

    position (rad) commands position mode, with velocity and effort as feed-forward; velocity
    (rad/s) alone velocity mode; effort (N·m) alone torque mode; nothing at all damps.
    """

    position: Floats | None = None
    velocity: Floats | None = None
    effort: Floats | None = None


def friction_table(plant: Plant, p: dict[str, Floats], step: float) -> Floats:
    """Return the table of friction between motor and joint [11, D], smooth through standstill.

    Dry friction sets in as a hyperbolic tangent of speed, the Stribeck part fades as the inverse
    square of 1 + (w/ws)², grease thins with speed, and the part that grows with load is stronger
    when the motor drives the joint than when the joint drives the motor.
    """
    effects = plant.effects
    coulomb = p['coulomb'] * effects.coulomb_friction.scale
    stribeck = p['stribeck'] * effects.stribeck_friction.scale
    viscous = p['viscous'] * effects.viscous_friction.scale
    load = p['load_friction'] * effects.load_friction.scale
    rub = p['rub'] * effects.position_rub.scale
    rotor = p['rotor_inertia'] * effects.rotor_inertia.scale
    link = 0.0 if effects.spring.enabled else _LINK_INERTIA
    dry = coulomb + stribeck + rub + load * p['torque_limit'] / 4
    slope = 1.0 / np.maximum(p['presliding_velocity'], step * dry / (_STABLE * (rotor + link)))
    rows = [coulomb, stribeck, viscous, load, load * p['load_asymmetry']]
    rows += [rub, p['rub_angle'], p['rub_width'], slope]
    return np.array([*rows, 1.0 / p['stribeck_velocity'], 1.0 / p['shear_velocity']])


@dataclass(frozen=True)
class Trace:
    """Signals of the drives in B steps, [B, D] each, at the motor unless stated otherwise."""

    position: Floats  # rad, rotor at the start of the step, in turns of the joint
    velocity: Floats  # rad/s, rotor at the start of the step
    motor: Floats  # N·m, air gap
    drag: Floats  # N·m, friction
    cogging: Floats  # N·m
    output: Floats  # N·m, handed to the joint (before the inertia of a rigidly coupled rotor)


class Drives:
    """Mechanical side of D drives, stepped beside the rigid-body simulation.

    The rotor turns with the joint (its inertia is then `armature`, for the joint's own solver)
    unless the plant's spring is on: then it has a state of its own behind that spring.
    """

    def __init__(
        self,
        plant: Plant,
        names: Sequence[str],
        step: float,
        block: int,
        parameters: dict[str, Floats] | None = None,
    ) -> None:
        """Make drives; step: s; block: most steps of a trace; parameters: of `Plant.resolve`."""
        p = plant.resolve(names) if parameters is None else parameters
        effects = plant.effects
        self.names = tuple(names)
        self.parameters = p
        self._signals = np.zeros((6, block, len(names)))
        self.trace = Trace(*self._signals)
        self.friction = friction_table(plant, p, step)
        self.inertia: Floats = p['rotor_inertia'] * effects.rotor_inertia.scale
        self.elastic = effects.spring.enabled
        self.stiffness: Floats = p['spring_stiffness'] / max(effects.spring.strength, 1e-3)
        self.damping: Floats = p['spring_damping']
        self.output_damping: Floats = p['output_viscous'] * effects.viscous_friction.scale
        self._step = step if self.elastic else 0.0
        weakening = effects.field_weakening.scale
        flux = p['reactance'] * p['weakening_current'] if weakening else 0.0
        self._stall = p['torque_constant'] * p['modulation'] / p['resistance']
        droop = p['torque_constant'] * (p['torque_constant'] - flux) / p['resistance']
        cogging = p['cogging'] * effects.cogging.scale
        rows = (droop, p['torque_limit'], cogging, p['cogging_order'], self.inertia)
        self._table = np.array((*rows, self.stiffness, self.damping))
        self._loop, steps = _loop_table(plant, p, self.inertia, self.stiffness, step)
        self._delayed, self._count = np.zeros((len(names), 1 + steps)), 0
        self.gains: tuple[Floats | float, ...] = (POSITION_GAIN, VELOCITY_GAIN)
        self._late = round(plant.command_delay / step)
        self._pending: deque[tuple[int, Floats]] = deque()
        self._held = np.zeros((5, len(names)))
        self._ceiling, self._floor = self._held[3:]
        self.rotor = np.zeros(len(names))
        self.rotor_velocity = np.zeros(len(names))
        self._held[1] = VELOCITY_GAIN
        self.set_voltage(plant.supply.voltage)

    @property
    def armature(self) -> Floats:
        """Inertia rigidly coupled to the joints, kg·m² [D]."""
        output: Floats = self.parameters['output_inertia']
        return output if self.elastic else output + self.inertia

    def reset(self, position: Floats, which: slice | NDArray[np.intp] = _ALL) -> None:
        """Reset rotors of drives (`which`: slice or indices) to rest at joint angles, rad."""
        self.rotor[which] = position
        self.rotor_velocity[which] = 0.0
        self._delayed[which] = 0.0

    def hold(self, command: JointCommand) -> None:
        """Hold a command once the plant's delay has passed; NaN in it damps that drive."""
        count = len(self.names)
        nothing = np.zeros(count)
        velocity = nothing if command.velocity is None else command.velocity
        effort = nothing if command.effort is None else command.effort
        if command.position is not None:
            (kp, kd), target = self.gains, command.position
        elif command.velocity is not None:
            kp, kd, target = 0.0, SPEED_MODE_GAIN, nothing
        elif command.effort is not None:
            kp, kd, target = 0.0, 0.0, nothing
        else:
            kp, kd, target = 0.0, self.gains[1], nothing
        feed = kp * target + kd * velocity + effort
        good = np.isfinite(feed)
        held = (
            np.where(good, kp, 0.0),
            np.where(good, kd, self.gains[1]),
            np.where(good, feed, 0.0),
        )
        self._pending.append((self._count + self._late, np.array(held)))

    def set_voltage(self, voltage: float) -> None:
        """Set the bus voltage, V, which limits torque at speed."""
        self._ceiling[:] = self._stall * voltage
        self._floor[:] = -self._ceiling

    def step(self, row: int, position: Floats, velocity: Floats, out: Floats) -> None:
        """Write the torque on the joints for the next step, N·m [D], to out and to the trace.

        position (rad) and velocity (rad/s) are the joints' now; row counts within the block.
        """
        while self._pending and self._pending[0][0] <= self._count:
            self._held[:3] = self._pending.popleft()[1]
        drive_step(
            self.friction,
            self._table,
            self._held,
            position,
            velocity,
            self.rotor,
            self.rotor_velocity,
            row,
            self._signals,
            self._step,
            out,
            self._loop,
            self._delayed,
            self._count,
        )
        self._count += 1


def _loop_table(
    plant: Plant, p: dict[str, Floats], inertia: Floats, stiffness: Floats, step: float
) -> tuple[Floats, int]:
    """Return the table of the torque loops, and the steps that they remember; 0 without loops.

    The gains on the error, and on the spring's rate (N·m·s/rad), place the poles of a rotor,
    kg·m², behind a spring, N·m/rad, whose joint is held; what damps beside the loop adds to it.
    Without the effect both are 0: the motor then gives what the position loop asks of it.
    """
    effects = plant.effects
    gain = damping = np.zeros_like(inertia)
    if effects.torque_loop.enabled:
        natural = 2.0 * np.pi * p['loop_bandwidth']
        gain = np.maximum(natural * natural * inertia / stiffness - 1.0, 0.0)
        damping = 2.0 * p['loop_damping'] * np.sqrt((1.0 + gain) * stiffness * inertia)
    delay = np.rint(p['loop_delay'] * effects.torque_loop.scale / step)
    follows = 1.0 - np.exp(-2.0 * np.pi * p['current_bandwidth'] * step)
    ripple = p['torque_ripple'] * effects.torque_ripple.scale
    dead = p['dead_torque'] * effects.dead_time.scale
    table = np.array((gain, damping, follows, delay, ripple, p['ripple_order'], dead))
    return table, int(delay.max()) + 1 if effects.torque_loop.enabled else 0
