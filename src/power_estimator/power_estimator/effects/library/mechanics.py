"""Mechanical power at the joint, and the motion of rotor and series spring."""

import numpy as np
from wattwalk_core.arrays import Floats

from power_estimator.effects.effect import Effect, Excitation, Term
from power_estimator.effects.signals.state import Signals


def _torque_rate(signals: Signals, *, relaxation: float = 0.0, **_: float) -> Floats:
    """The rate of the torque, as the damped spring follows it."""
    from scipy.signal import lfilter  # slow to import; few models have this effect

    if relaxation <= 0.0:
        return signals.torque_rate[..., None]
    keep = np.exp(-1.0 / (signals.rate * relaxation))
    rate = np.zeros_like(signals.torque_rate)
    for part in signals.stretches():
        own = signals.torque_rate[part]
        rate[part], _state = lfilter([1.0 - keep], [1.0, -keep], own, axis=0, zi=keep * own[:1])
    return rate[..., None]


SHAFT = Effect(
    name='shaft',
    physics='mechanical power delivered to the joint, negative while the joint drives the motor',
    formula='torque·speed, coefficient fixed at 1',
    terms=(Term('c', '1', 1.0, 1.0),),
    scaling={},
    regressors=lambda signals, **_: (signals.torque * signals.velocity)[..., None],
    fixed=1.0,
    per_drive=True,
    near=('power_gain',),
    excitation=Excitation(
        'driving and back-driving at several speeds and loads',
        speeds=(1.0, 3.0, -1.0, -3.0),
        loads=(-20.0, 0.0, 20.0),
    ),
)
ROTOR_INERTIA = Effect(
    name='rotor_inertia',
    physics='accelerating the rotor takes torque that no joint sensor sees',
    formula='J·w·dw/dt + 2·k·J·torque·dw/dt',
    terms=(Term('J', 'kg·m²', 0.0, 5.0),),
    scaling={'gear_ratio': (2.0,)},
    regressors=lambda signals, **_: signals.motor_acceleration[..., None],
    acts_on='torque',
    needs_joint_torque=True,
    per_drive=True,
    needs_time=True,
    near=('time_offset', 'velocity_lag', 'spring'),
    excitation=Excitation(
        'unloaded fast reversals', mode='position', frequency=4.0, amplitude=0.3, seconds=20.0
    ),
)
SPRING = Effect(
    name='spring',
    physics='the motor also turns to load the series spring, and friction acts on that too',
    formula='(torque + friction)·dx/dt, relaxation·dx²/dt² + dx/dt = dtorque/dt/ks',
    terms=(Term('1/ks', 'rad/(N·m)', 0.0, 0.05),),
    scaling={},
    regressors=_torque_rate,
    acts_on='speed',
    per_drive=True,
    needs_time=True,
    # It is in the speed of its own motor, and hardly any log says whose speed it has.
    proposed=lambda signals: not bool(signals.at_motor.any()),
    shapes=tuple({'relaxation': seconds} for seconds in (0.0, 0.003, 0.006, 0.012)),
    near=('time_offset', 'rotor_inertia'),
    excitation=Excitation(
        'fast steps of torque at a locked joint',
        mode='torque',
        speeds=(0.0,),
        loads=(-30.0, 30.0),
        frequency=3.0,
        seconds=20.0,
    ),
)
"""Relaxation: damping over stiffness of a spring that is damped, in s."""
