"""Power that the bus does not take back."""

import numpy as np

from power_estimator.effects.effect import Effect, Excitation, Floats, Term
from power_estimator.effects.signals.state import Signals


class RegenerationLimit(Effect):
    """Blocked return of power while the sum of all drives is negative."""

    name = 'regeneration_limit'
    physics = 'the supply takes nothing back: what the drives return together is burnt'
    formula = 'b·(share of the drive)·max(0, −sum of P over the bus)'
    follows = frozenset({'drawn'})
    terms = (Term('b', '1', 0.0, 1.0, attained=True),)
    near = ('regeneration_efficiency',)
    excitation = Excitation(
        'back-driving one drive with the others at rest, then with the others drawing',
        speeds=(3.0, -3.0),
        loads=(-30.0, 30.0),
    )

    def regressors(self, signals: Signals, **shape: float) -> Floats:
        """The drive's share of the power that is blocked."""
        returned = np.maximum(0.0, -signals.drawn)
        blocked = np.maximum(0.0, -signals.drawn.sum(axis=1, keepdims=True))
        share = returned / np.maximum(returned.sum(axis=1, keepdims=True), 1e-9)
        return (share * blocked)[..., None]

    def drawn_slope(self, signals: Signals, coefficients: Floats, **shape: float) -> Floats:
        """Minus the blocked share while power flows back."""
        returned = np.maximum(0.0, -signals.drawn)
        blocked = np.maximum(0.0, -signals.drawn.sum(axis=1, keepdims=True))
        share = blocked / np.maximum(returned.sum(axis=1, keepdims=True), 1e-9)
        return np.where(signals.drawn < 0.0, -coefficients[..., 0] * share, 0.0)
