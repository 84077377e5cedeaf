"""Extra friction at low speed."""

import numpy as np

from power_estimator.effects.effect import Effect, Excitation, Floats, Shape, Term, smooth_sign
from power_estimator.effects.signals.scale import DriveScale
from power_estimator.effects.signals.state import Signals


class StribeckFriction(Effect):
    """Friction that falls with speed as a lubricant film builds up."""

    name = 'stribeck_friction'
    physics = 'surfaces touch at low speed until the lubricant carries them'
    formula = 'Ts·exp(−(w/speed)²)·(|w| + 2·k·torque·sgn w)'
    per_drive = True
    terms = (Term('Ts', 'N·m', 0.0, 80.0),)
    acts_on = 'torque'
    needs_joint_torque = True
    near = ('coulomb_friction',)
    shapes = tuple({'speed': speed} for speed in (0.1, 0.2, 0.35, 0.6, 1.0, 1.6))
    excitation = Excitation(
        'a ladder of slow constant speeds in both directions, loaded so that copper shows it',
        speeds=(0.05, 0.1, 0.2, 0.4, 0.8, 2.0, -0.05, -0.1, -0.2, -0.4, -0.8, -2.0),
        loads=(0.0, 20.0),
    )

    def regressors(self, signals: Signals, *, speed: float = 0.35, **_: float) -> Floats:
        """The sign of the speed, fading out above the Stribeck speed."""
        velocity = signals.motor_velocity
        sign = smooth_sign(velocity, signals.scale.standstill)
        return (np.exp(-np.square(velocity / speed)) * sign)[..., None]

    def shapes_of(self, scale: DriveScale) -> tuple[Shape, ...]:
        """Stribeck speeds in proportion to the drives' speeds."""
        factors = sorted(set(scale.speed.tolist()))
        return tuple({'speed': shape['speed'] * f} for f in factors for shape in self.shapes)
