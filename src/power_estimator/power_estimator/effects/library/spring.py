"""The series spring between gear and joint."""

import numpy as np

from power_estimator.effects.effect import Effect, Excitation, Floats, Term
from power_estimator.effects.signals.state import Signals


class Spring(Effect):
    """
    Motion of the motor relative to the joint while the series spring is loaded.

    A spring that is damped follows a change of torque with a relaxation time (damping over
    stiffness), and so does the motor.
    """

    name = 'spring'
    physics = 'the motor also turns to load the series spring, and friction acts on that too'
    formula = '(torque + friction)·dx/dt, relaxation·dx²/dt² + dx/dt = dtorque/dt/ks'
    per_drive = True
    terms = (Term('1/ks', 'rad/(N·m)', 0.0, 0.05, least=3e-4),)
    acts_on = 'speed'
    needs_joint_torque = True
    near = ('time_offset', 'rotor_inertia')
    shapes = tuple({'relaxation': seconds} for seconds in (0.0, 0.003, 0.006, 0.012))
    excitation = Excitation(
        'fast steps of torque at a locked joint',
        mode='torque',
        speeds=(0.0,),
        loads=(-30.0, 30.0),
        frequency=3.0,
        seconds=20.0,
    )

    def regressors(self, signals: Signals, *, relaxation: float = 0.0, **_: float) -> Floats:
        """The rate of the torque, as the damped spring follows it."""
        from scipy.signal import lfilter

        if relaxation <= 0.0:
            return signals.torque_rate[..., None]
        keep = np.exp(-1.0 / (signals.rate * relaxation))
        rate = np.zeros_like(signals.torque_rate)
        for part in signals.stretches():
            own = signals.torque_rate[part]
            rate[part], _state = lfilter(
                [1.0 - keep], [1.0, -keep], own, axis=0, zi=keep * own[:1]
            )
        return rate[..., None]
