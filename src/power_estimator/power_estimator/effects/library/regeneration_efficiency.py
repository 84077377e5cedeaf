"""Loss of power that returns to the bus."""

import numpy as np

from power_estimator.effects.effect import Effect, Excitation, Floats, Term
from power_estimator.effects.signals.state import Signals


class RegenerationEfficiency(Effect):
    """Share of the returned power that is lost."""

    name = 'regeneration_efficiency'
    physics = 'of the power that a braking drive returns only the part eta arrives at the bus'
    formula = '(1 − eta)·max(0, −P); with bridge = 1, P without the electronics'
    follows = frozenset({'drawn'})
    per_drive = True
    terms = (Term('1 − eta', '1', 0.0, 1.0, attained=True),)
    shapes = ({'bridge': 0.0}, {'bridge': 1.0})
    near = ('regeneration_limit', 'load_friction')
    excitation = Excitation(
        'back-driving at three loads and two speeds while other drives draw',
        speeds=(2.0, 4.0, -2.0, -4.0),
        loads=(-30.0, -15.0, 15.0, 30.0),
    )

    def regressors(self, signals: Signals, *, bridge: float = 0.0, **_: float) -> Floats:
        """The power that would flow back through the bridge, or into the drive's input."""
        return np.maximum(0.0, -self._flow(signals, bridge))[..., None]

    def drawn_slope(self, signals: Signals, coefficients: Floats, **shape: float) -> Floats:
        """Minus the lost share while power flows back."""
        flow = self._flow(signals, shape.get('bridge', 0.0))
        return np.where(flow < 0.0, -coefficients[..., 0], 0.0)

    @staticmethod
    def _flow(signals: Signals, bridge: float) -> Floats:
        return signals.drawn - bridge * signals.electronics
