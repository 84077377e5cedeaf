"""Mechanical power at the joint."""

from power_estimator.effects.effect import Effect, Excitation, Floats, Term
from power_estimator.effects.signals.state import Signals


class Shaft(Effect):
    """Mechanical power: torque times speed."""

    name = 'shaft'
    physics = 'mechanical power delivered to the joint, negative while the joint drives the motor'
    formula = 'torque·speed, coefficient fixed at 1'
    per_drive = True
    terms = (Term('c', '1', 1.0, 1.0),)
    fixed = 1.0
    near = ('power_gain',)
    excitation = Excitation(
        'driving and back-driving at several speeds and loads',
        speeds=(1.0, 3.0, -1.0, -3.0),
        loads=(-20.0, 0.0, 20.0),
    )

    def regressors(self, signals: Signals, **shape: float) -> Floats:
        """Torque times speed."""
        return (signals.torque * signals.velocity)[..., None]
