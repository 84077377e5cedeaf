"""Friction that grows with speed."""

from power_estimator.effects.effect import Effect, Excitation, Floats, Term, log_speed
from power_estimator.effects.signals.state import Signals


class ViscousFriction(Effect):
    """Friction of grease and seals in proportion to speed."""

    name = 'viscous_friction'
    physics = 'grease drags in proportion to speed, and the motor carries that torque as well'
    formula = 'B·w² + 2·k·torque·B·w'
    per_drive = True
    terms = (Term('B', 'N·m·s/rad', 0.0, 100.0),)
    acts_on = 'torque'
    needs_joint_torque = True
    near = ('iron_loss', 'coulomb_friction')
    discrepancy_limit = 0.12
    excitation = Excitation(
        'a ladder of constant speeds in both directions, unloaded and loaded',
        speeds=(0.3, 0.8, 1.5, 2.5, 4.0, -0.3, -0.8, -1.5, -2.5, -4.0),
        loads=(0.0, 15.0),
    )

    def regressors(self, signals: Signals, **shape: float) -> Floats:
        """The speed."""
        return signals.motor_velocity[..., None]

    def discrepancy(self, signals: Signals, **shape: float) -> Floats:
        """Exponent other than 1, as of grease that thins with speed."""
        return signals.motor_velocity * log_speed(signals.motor_velocity)
