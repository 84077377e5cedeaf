"""Physical effects in the electrical power of a joint drive, one class each."""

from power_estimator.effects.catalogue import (
    Catalogue,
    builtin_catalogue,
    load_catalogue,
)
from power_estimator.effects.effect import Effect, Excitation, Shape, Term, smooth_sign
from power_estimator.effects.library.model_discrepancy import ModelDiscrepancy
from power_estimator.effects.signals.state import Signals

__all__ = [
    'Catalogue',
    'Effect',
    'Excitation',
    'ModelDiscrepancy',
    'Shape',
    'Signals',
    'Term',
    'builtin_catalogue',
    'load_catalogue',
    'smooth_sign',
]
