"""The series spring between gear and joint."""

from power_estimator.effects.effect import Effect, Excitation, Floats, Term
from power_estimator.effects.signals import Signals


class Spring(Effect):
    """Energy that the series spring takes in and gives back."""

    name = 'spring'
    physics = 'the series spring stores energy while it is loaded and returns it later'
    formula = 'torque·dtorque/dt/ks'
    terms = (Term('1/ks', 'rad/(N·m)', 0.0, 0.1),)
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
        """Torque times its rate."""
        return (signals.torque * signals.torque_rate)[..., None]
