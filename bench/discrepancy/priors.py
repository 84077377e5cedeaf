"""Prior knowledge of drives and sensors."""

from typing import Final

import numpy as np

MISSING: Final = {
    'copper_loss': 0.98,  # every winding has it
    'idle': 0.8,  # and nearly every meter sees the electronics
    'viscous_friction': 0.4,
    'coulomb_friction': 0.4,
    'rotor_inertia': 0.4,
    'inverter_loss': 0.3,
    'iron_loss': 0.3,
    'load_friction': 0.25,
    'spring': 0.25,
    'winding_heating': 0.25,
    'stribeck_friction': 0.15,
    'line_resistance': 0.15,
    'regeneration_efficiency': 0.15,
    'regeneration_limit': 0.15,
    'cogging': 0.1,
    'field_weakening': 0.05,
}
"""Prior probability that drives of a model without the effect have it to a degree that shows."""
SIZES: Final = np.array([0.02, 0.1, 0.5, 2.0])
"""Prior spread of an effect's watts, of the rms power: any of these."""
KNOWN_SIZE: Final = 4.0  # that of effects that the model has: as good as flat
SPIKE: Final = 0.003  # of the rms power, explained by an effect that counts as absent
DISCREPANCY: Final = np.array([5e-4, 3e-3, 2e-2])  # of the rms power
BENT: Final = np.array([0.01, 0.06])  # smooth departures, of an effect's own power
KINDS: Final = {
    'friction': (
        'viscous_friction',
        'coulomb_friction',
        'stribeck_friction',
        'load_friction',
        'cogging',
    ),
    'copper': ('copper_loss', 'inverter_loss', 'winding_heating'),
    'iron': ('iron_loss', 'field_weakening'),
    'idle': ('idle',),
    'bus': ('line_resistance', 'regeneration_efficiency', 'regeneration_limit'),
    'motion': ('rotor_inertia', 'spring'),
}
DEPARTURES: Final = {
    'friction': (0.2, 0.1, 0.1, 0.1, 0.15),
    'copper': (0.0, 0.1, 0.03, 0.0, 0.0),
    'iron': (0.2, 0.1, 0.05, 0.05, 0.0),
    'idle': (0.02, 0.02, 0.0, 0.05, 0.0),
    'bus': (0.1, 0.1, 0.1, 0.0, 0.0),
    'motion': (0.05, 0.05, 0.05, 0.0, 0.0),
    'shaft': (0.0, 0.01, 0.01, 0.0, 0.0),
}
"""Spreads of an effect: exponent of speed, of load, by direction, over the time, at low speed."""
ALIKE: Final = 0.5  # share of a formula's error that drives of one robot have in common
BLOCK: Final = 2.0  # s
TRIED: Final = 3  # sets of one effect more that are judged at their own point
WORTH: Final = 0.5  # nats, of a further effect
STEPS: Final = 6
NAMED: Final = 0.95


COEFFICIENTS: Final = {
    'copper_loss': 'k',
    'rotor_inertia': 'inertia',
    'idle': 'idle',
    'spring': 'spring',
    'load_friction': 'load_friction',
}
