"""The departure of an active effect from its formula, as a nuisance with a bounded share."""

from power_estimator.effects.effect import Effect, Excitation, Floats, Shape, Term
from power_estimator.effects.signals.state import Signals


class ModelDiscrepancy(Effect):
    """Departure of a real drive from the formula of one effect."""

    kind = 'discrepancy'
    physics = 'the effect as real drives have it, not quite the formula'
    formula = 'see the effect'
    terms = (Term('share', '1', -10.0, 10.0),)
    excitation = Excitation('none')

    def __init__(self, of: Effect, shape: Shape) -> None:
        self.of = of
        self.name = f'{of.name}~'  # type: ignore[misc]
        self.acts_on = of.acts_on  # type: ignore[misc]
        self.follows = of.follows  # type: ignore[misc]
        self.per_drive = of.per_drive  # type: ignore[misc]
        self.discrepancy_limit = of.discrepancy_limit  # type: ignore[misc]
        self.shape = tuple(shape.items())

    def regressors(self, signals: Signals, **_: float) -> Floats:
        """Departure of the parent effect."""
        values = self.of.discrepancy(signals, **dict(self.shape))
        if values is None:
            raise ValueError(f'effect {self.of.name!r} has a discrepancy_limit but no discrepancy')
        return values[..., None]
