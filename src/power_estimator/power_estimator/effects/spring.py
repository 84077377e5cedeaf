"""The series spring between gear and joint."""

from power_estimator.effects.effect import Effect, Excitation, Floats, Term
from power_estimator.effects.signals import Signals


class Spring(Effect):
    """The motor runs ahead of the joint while the series spring is being loaded."""

    name = 'spring'
    physics = (
        'the motor also turns to load the series spring, and friction acts on that motion too'
    )
    formula = (
        '(torque + friction)·dtorque/dt/ks, and friction at the motor speed w + dtorque/dt/ks'
    )
    terms = (Term('1/ks', 'rad/(N·m)', 0.0, 0.05, least=3e-4),)
    acts_on = 'speed'
    near = ('time_offset', 'rotor_inertia')
    excitation = Excitation(
        'fast steps of torque at a locked joint',
        mode='torque',
        speeds=(0.0,),
        loads=(-30.0, 30.0),
        frequency=3.0,
        seconds=20.0,
    )

    def regressors(self, signals: Signals, **shape: float) -> Floats:
        """The rate of the torque."""
        return signals.torque_rate[..., None]
