"""Losses of the alternating field in the stator."""

import numpy as np

from power_estimator.effects.effect import Effect, Excitation, Floats, Term
from power_estimator.effects.signals import Signals


class IronLoss(Effect):
    """Hysteresis and eddy currents."""

    name = 'iron_loss'
    physics = 'the rotating field magnetises the stator back and forth (h) and drives eddies (e)'
    formula = 'h·|w| + e·w²'
    terms = (Term('h', 'W·s/rad', 0.0, 100.0), Term('e', 'W·s²/rad²', 0.0, 100.0))
    near = ('viscous_friction', 'coulomb_friction')
    excitation = Excitation(
        'a ladder of constant speeds, unloaded and loaded: friction grows dearer under load, '
        'iron loss does not',
        speeds=(0.3, 0.8, 1.5, 2.5, 4.0, 6.0, -0.3, -0.8, -1.5, -2.5, -4.0, -6.0),
        loads=(-25.0, 0.0, 25.0),
    )

    def regressors(self, signals: Signals, **shape: float) -> Floats:
        """Speed and speed squared."""
        speed = np.abs(signals.velocity)
        return np.stack([speed, np.square(speed)], axis=-1)
