"""Current that weakens the field near top speed."""

import numpy as np

from power_estimator.effects.effect import Effect, Excitation, Floats, Shape, Term
from power_estimator.effects.signals.scale import DriveScale
from power_estimator.effects.signals.state import Signals


class FieldWeakening(Effect):
    """Extra current above the speed at which the back-EMF reaches the bus voltage."""

    name = 'field_weakening'
    physics = 'above base speed the controller spends current to hold the back-EMF down'
    formula = 'c·max(0, |w| − per_volt·V)²'
    per_drive = True
    terms = (Term('c', 'W·s²/rad²', 0.0, 1000.0),)
    shapes = tuple({'per_volt': speed / 48.0} for speed in (3.0, 4.0, 5.0, 5.5, 6.0, 6.5, 7.0))
    near = ('iron_loss', 'viscous_friction')
    excitation = Excitation(
        'constant speeds up to the highest, at two bus voltages',
        speeds=(4.0, 5.0, 6.0, 6.5, 7.0, 7.5, -4.0, -5.0, -6.0, -6.5, -7.0, -7.5),
        supply=(44.0, 50.0),
    )

    def regressors(self, signals: Signals, *, per_volt: float = 0.125, **_: float) -> Floats:
        """Squared excess over the base speed."""
        excess = np.abs(signals.motor_velocity) - per_volt * signals.voltage
        return np.square(np.maximum(0.0, excess))[..., None]

    def shapes_of(self, scale: DriveScale) -> tuple[Shape, ...]:
        """Base speeds in proportion to the drives' speeds, per volt of their bus."""
        factors = sorted(set((scale.speed / scale.voltage).tolist()))
        return tuple({'per_volt': shape['per_volt'] * f} for f in factors for shape in self.shapes)
