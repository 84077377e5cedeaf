"""Power of a drive at rest."""

import numpy as np

from power_estimator.effects.effect import Effect, Excitation, Floats, Term
from power_estimator.effects.signals.state import Signals

NOMINAL = 48.0
"""V, the bus at which the draw is given."""


class Idle(Effect):
    """Electronics, sensors and communication."""

    name = 'idle'
    physics = 'electronics draw power whether the drive moves or not'
    formula = 'P0'
    per_drive = True
    terms = (Term('P0', 'W', 0.0, 500.0),)
    near = ('current_offset',)
    discrepancy_limit = 1.0
    excitation = Excitation(
        'rest without load, at two bus voltages',
        mode='torque',
        speeds=(0.0,),
        seconds=20.0,
        supply=(44.0, 52.0),
    )

    def regressors(self, signals: Signals, **shape: float) -> Floats:
        """One."""
        return np.ones_like(signals.torque)[..., None]

    def discrepancy(self, signals: Signals, **shape: float) -> Floats:
        """Electronics that draw a constant current rather than a constant power."""
        return signals.voltage / NOMINAL - 1.0
