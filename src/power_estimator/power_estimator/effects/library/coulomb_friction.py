"""Friction that does not depend on speed."""

from power_estimator.effects.effect import Effect, Excitation, Floats, Term, log_speed, smooth_sign
from power_estimator.effects.signals.state import Signals


class CoulombFriction(Effect):
    """Dry friction of gear and bearings."""

    name = 'coulomb_friction'
    physics = 'dry friction: the same torque at every speed, against the motion'
    formula = 'Tc·(|w| + 2·k·torque·sgn w)'
    per_drive = True
    terms = (Term('Tc', 'N·m', 0.0, 80.0),)
    acts_on = 'torque'
    needs_joint_torque = True
    near = ('viscous_friction', 'iron_loss', 'stribeck_friction')
    discrepancy_limit = 0.12
    excitation = Excitation(
        'a ladder of constant speeds in both directions, unloaded and loaded',
        speeds=(0.3, 0.8, 1.5, 2.5, 4.0, -0.3, -0.8, -1.5, -2.5, -4.0),
        loads=(0.0, 15.0),
    )

    def regressors(self, signals: Signals, **shape: float) -> Floats:
        """The sign of the speed."""
        return smooth_sign(signals.motor_velocity, signals.scale.standstill)[..., None]

    def discrepancy(self, signals: Signals, **shape: float) -> Floats:
        """A slow rise or fall with speed."""
        return smooth_sign(signals.motor_velocity, signals.scale.standstill) * log_speed(
            signals.motor_velocity
        )
