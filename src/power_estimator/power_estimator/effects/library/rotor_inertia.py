"""Torque that turns the rotor itself."""

from power_estimator.effects.effect import Effect, Excitation, Floats, Term
from power_estimator.effects.signals.state import Signals


class RotorInertia(Effect):
    """Inertia of rotor and gear, as seen at the joint."""

    name = 'rotor_inertia'
    physics = 'accelerating the rotor takes torque that no joint sensor sees'
    formula = 'J·w·dw/dt + 2·k·J·torque·dw/dt'
    per_drive = True
    terms = (Term('J', 'kg·m²', 0.0, 5.0),)
    acts_on = 'torque'
    needs_joint_torque = True
    near = ('time_offset', 'velocity_lag', 'spring')
    excitation = Excitation(
        'unloaded fast reversals', mode='position', frequency=4.0, amplitude=0.3, seconds=20.0
    )

    def regressors(self, signals: Signals, **shape: float) -> Floats:
        """The acceleration."""
        return signals.motor_acceleration[..., None]
