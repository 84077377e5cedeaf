"""Torque ripple that repeats with the position."""

import numpy as np

from power_estimator.effects.effect import Effect, Excitation, Floats, Term
from power_estimator.effects.signals.state import Signals


class Cogging(Effect):
    """Attraction between the magnets and the stator's teeth."""

    name = 'cogging'
    physics = 'magnets and teeth pull the rotor to and fro, a fixed number of times per turn'
    formula = 'A·sin(order·q + phase)·w + 2·k·torque·A·sin(order·q + phase)'
    per_drive = True
    terms = (
        Term('A·cos(phase)', 'N·m', -20.0, 20.0),
        Term('A·sin(phase)', 'N·m', -20.0, 20.0),
    )
    acts_on = 'torque'
    needs_joint_torque = True
    near = ('rotor_inertia',)
    shapes = tuple({'order': float(order)} for order in (6, 7, 12, 14, 21, 24, 36, 42, 50, 100))
    excitation = Excitation(
        'slow constant speeds, so that the ripple is slower than the meter',
        speeds=(0.05, 0.1, 0.2, -0.05, -0.1, -0.2),
        loads=(0.0, 20.0),
        seconds=15.0,
    )

    def regressors(self, signals: Signals, *, order: float = 12.0, **_: float) -> Floats:
        """Sine and cosine of the position times the order."""
        angle = order * signals.position
        return np.stack([np.sin(angle), np.cos(angle)], axis=-1)

    def usable(self, signals: Signals, **shape: float) -> bool:
        """Return whether the position was recorded."""
        return super().usable(signals) and bool(np.isfinite(signals.position).all())
