"""Resistance of the cables between meter and drive."""

import numpy as np

from power_estimator.effects.effect import Effect, Excitation, Floats, Term
from power_estimator.effects.signals.state import Signals


class LineResistance(Effect):
    """The supply line heats, and the voltage at the drive sags."""

    name = 'line_resistance'
    physics = 'the current drawn heats the cable between the meter and the drive'
    formula = 'Rl·(P/V)²'
    follows = frozenset({'drawn'})
    per_drive = True
    terms = (Term('Rl', 'ohm', 0.0, 5.0),)
    near = ('copper_loss',)
    excitation = Excitation(
        'high power at high speed, and the same current at standstill, at two bus voltages',
        speeds=(0.0, 4.0, -4.0),
        loads=(-40.0, 40.0),
        supply=(44.0, 52.0),
    )

    def regressors(self, signals: Signals, **shape: float) -> Floats:
        """Current at the drive's input squared."""
        return np.square(signals.drawn / np.maximum(signals.voltage, 1.0))[..., None]

    def drawn_slope(self, signals: Signals, coefficients: Floats, **shape: float) -> Floats:
        """Twice the resistance times current over voltage."""
        return 2.0 * coefficients[..., 0] * signals.drawn / np.square(signals.voltage)
