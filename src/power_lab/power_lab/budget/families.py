"""Families of the parts of a budget, as pictures show them."""

from collections.abc import Mapping
from typing import Final

FAMILIES: Final[Mapping[str, tuple[str, str, tuple[str, ...]]]] = {
    'shaft': ('work on the joints', '#0072B2', ('shaft',)),
    'regeneration': ('given back by the joints', '#56B4E9', ('regeneration',)),
    'copper': (
        'copper and cables',
        '#D55E00',
        ('copper_loss', 'winding_heating', 'saturation', 'line_resistance'),
    ),
    'gear': (
        'friction, spring and rotor',
        '#E69F00',
        (
            *('coulomb_friction', 'viscous_friction', 'stribeck_friction', 'load_friction'),
            *('cogging', 'rotor_inertia', 'spring'),
        ),
    ),
    'iron': ('iron', '#F0E442', ('iron_loss', 'field_weakening')),
    'inverter': ('inverter', '#CC79A7', ('inverter_loss',)),
    'burnt': ('braking power burnt', '#882255', ('regeneration_efficiency', 'regeneration_limit')),
    'idle': ('idle', '#009E73', ('idle',)),
    'losses': ('losses of the drives', '#AA4499', ('losses',)),  # of models that do not say which
    'drives': ('drives', '#332288', ('drives',)),  # without a model
    'electronics': ('electronics', '#A6A6A6', ('electronics',)),
    'other': ('other effects and meter', '#999933', ()),
    'unexplained': ('unexplained', 'none', ('unexplained',)),
}
"""Words, colour for the colour-blind, and effects of each; `other` has all that no family has."""


def family_of(effect: str) -> str:
    """Key of the family in FAMILIES that an effect is drawn in; `other` where none has it."""
    return next((name for name, (_, _, own) in FAMILIES.items() if effect in own), 'other')
