"""Steps of drives and feet, compiled: friction, torque and forces at one instant."""

from math import sin, tanh
from typing import Final

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.arrays import Floats
from wattwalk_core.compiled import compiled

FRICTION: Final = (
    *('coulomb', 'stribeck', 'viscous', 'load', 'asymmetry', 'rub', 'rub_angle', 'rub_width'),
    *('slope', 'fade', 'thin'),
)
"""Rows of the table of friction [11, D]."""
DRIVE: Final = ('droop', 'limit', 'cogging', 'order', 'inertia', 'stiffness', 'damping')
"""Rows of the table of drives [7, D]."""
LOOP: Final = ('gain', 'damping', 'follows', 'delay', 'ripple', 'ripple_order', 'dead')
"""Rows of the table of torque loops [7, D]."""
_RAMP: Final = 0.02  # of the torque limit, over which the inverter's dead time turns its sign
HELD: Final = ('kp', 'kd', 'feed', 'ceiling', 'floor')
"""Rows of what is held until the next command or reading of the bus voltage [5, D]."""


@compiled('void(f8[:, ::1], f8[::1], f8[::1], f8[::1], f8[::1])')
def friction_torque(
    table: Floats, position: Floats, velocity: Floats, motor: Floats, out: Floats
) -> None:
    """Write the drag on motors at one instant, N·m [D], to out; table: rows of FRICTION."""
    for d in range(len(out)):
        speed = velocity[d]
        sign = tanh(speed * table[8, d])
        fade = speed * table[9, d]
        fade = fade * fade + 1.0
        drag = table[0, d] + table[1, d] / (fade * fade)
        drag = drag + table[3, d] * abs(motor[d]) + table[4, d] * motor[d] * sign
        away = (abs(position[d]) - table[6, d]) / table[7, d]
        away = 1.0 + away * away
        drag = (drag + table[5, d] / (away * away)) * sign
        out[d] = drag + table[2, d] * speed / (abs(speed) * table[10, d] + 1.0)


@compiled(
    'void(f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[::1], f8[::1], f8[::1], f8[::1], i8,'
    ' f8[:, :, ::1], f8, f8[::1], f8[:, ::1], f8[:, ::1], i8)'
)
def drive_step(
    friction: Floats,
    drive: Floats,
    held: Floats,
    position: Floats,
    velocity: Floats,
    rotor: Floats,
    rotor_velocity: Floats,
    row: int,
    trace: Floats,
    step: float,
    out: Floats,
    loop: Floats,
    delayed: Floats,
    count: int,
) -> None:
    """Write the torque on D joints for the next step, N·m [D], to out and row to trace [6, B, D].

    The tables have the rows of FRICTION, DRIVE and HELD, trace those of `Trace`. position (rad)
    and velocity (rad/s) are the joints'. step: s, by which rotors behind springs turn; 0 where
    they are rigidly coupled to the joints.
    """
    elastic, steps = step > 0.0, delayed.shape[1] - 1
    motor, drag, output = trace[2, row], trace[3, row], trace[5, row]
    for d in range(len(out)):
        speed = rotor_velocity[d] if elastic else velocity[d]
        droop = drive[0, d] * speed
        damped = velocity[d] if steps > 0 else speed
        torque = held[2, d] - held[0, d] * position[d] - held[1, d] * damped
        torque = max(min(torque, held[3, d] - droop), held[4, d] - droop)
        torque = max(min(torque, drive[1, d]), -drive[1, d])
        if steps > 0:
            turning = rotor_velocity[d] - velocity[d]
            read = drive[5, d] * (rotor[d] - position[d])
            asked = torque + loop[0, d] * (torque - read) - loop[1, d] * turning
            asked = max(min(asked, held[3, d] - droop), held[4, d] - droop)
            delayed[d, 1 + count % steps] = max(min(asked, drive[1, d]), -drive[1, d])
            late = delayed[d, 1 + (count - int(loop[3, d])) % steps]
            delayed[d, 0] += loop[2, d] * (late - delayed[d, 0])
            torque = delayed[d, 0]
        if loop[4, d] != 0.0:
            angle = rotor[d] if elastic else position[d]
            torque *= 1.0 + loop[4, d] * sin(loop[5, d] * angle)
        if loop[6, d] != 0.0:
            torque -= loop[6, d] * tanh(torque / (_RAMP * drive[1, d]))
        motor[d] = torque
        trace[0, row, d] = rotor[d] if elastic else position[d]
        trace[1, row, d] = speed
    friction_torque(friction, trace[0, row], trace[1, row], motor, drag)
    for d in range(len(out)):
        torque = motor[d] - drag[d]
        if drive[2, d] != 0.0:
            cogging = drive[2, d] * sin(drive[3, d] * trace[0, row, d])
            trace[4, row, d] = cogging
            torque = torque - cogging
        if elastic:
            twist = drive[5, d] * (rotor[d] - position[d])
            twist = twist + drive[6, d] * (rotor_velocity[d] - velocity[d])
            rotor_velocity[d] += (torque - twist) * (step / drive[4, d])
            rotor[d] += rotor_velocity[d] * step
            torque = twist
        out[d] = torque
        output[d] = torque


@compiled('void(i8[::1], i4[:, :], i4[:], f8[:], f8[::1])')
def foot_force(
    feet: NDArray[np.int64],
    geoms: NDArray[np.int32],
    addresses: NDArray[np.int32],
    forces: Floats,
    out: Floats,
) -> None:
    """Add the normal forces of C contacts, N, to those of F feet, out [F].

    feet: index of the foot by the geom's, F for any other; geoms [C, 2]; addresses: of a
    contact's normal force among forces, negative for one that does not act [C].
    """
    for index in range(len(addresses)):
        if addresses[index] >= 0:
            foot = min(feet[geoms[index, 0]], feet[geoms[index, 1]])
            if foot < len(out):
                out[foot] += forces[addresses[index]]
