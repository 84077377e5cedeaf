"""Physical effects in the electrical power of a joint drive, by name."""

from power_estimator.effects.catalogue import Catalogue, builtin_catalogue, load_catalogue
from power_estimator.effects.effect import Effect, Excitation, Shape, Term, smooth_sign
from power_estimator.effects.signals.state import Signals

__all__ = [
    'Catalogue',
    'Effect',
    'Excitation',
    'Shape',
    'Signals',
    'Term',
    'builtin_catalogue',
    'load_catalogue',
    'smooth_sign',
]
