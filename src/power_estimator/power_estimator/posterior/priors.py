"""Prior knowledge of drives and sensors."""

from collections.abc import Mapping
from typing import Final

import numpy as np

MISSING: Final[Mapping[str, float]] = {
    'copper_loss': 0.995,  # every winding has it
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
    'motor_saturation': 0.1,
    'magnet_heating': 0.1,
    'field_weakening': 0.05,
}
"""Prior probability that drives of a model without the effect have it to a degree that shows."""
USUAL: Final = 0.25
"""The same of an effect that is neither usual nor rare."""
EXPECTED: Final = 0.9
"""The same of heating where a temperature was seen to move far: its sensor may be elsewhere."""
OF_USERS: Final = 0.15  # the same of an effect that users wrote
SIZES: Final = np.array([0.02, 0.1, 0.5, 2.0])
"""Prior spread of an effect's watts, of the rms power: any of these."""
BAD_CABLE: Final = 0.1  # of the power, that a line loses: by this much its sizes are smaller
KNOWN_SIZE: Final = 4.0  # that of effects that the model has: as good as flat
SHARES: Final[Mapping[str, tuple[float, float]]] = {
    'regeneration_efficiency': (0.0, 0.3),  # converters return the most of it
    'regeneration_limit': (1.0, 0.1),  # a supply takes it or does not
}
"""
Prior mean and spread of coefficients that are shares of a power, in place of sizes in watts.

Both effects are one on a bench with one drive: only by how much is lost they are told apart.
"""
SPIKE: Final = 0.003  # of the rms power, explained by an effect that counts as absent
DISCREPANCY: Final = np.array([2e-3, 1e-2, 3e-2, 0.1])
DEPARTING: Final = np.array([0.02, 0.1, 0.4])
_NAMES: Final[Mapping[str, tuple[str, ...]]] = {
    'viscous': ('viscous_friction',),
    'friction': ('coulomb_friction', 'stribeck_friction', 'load_friction'),
    'copper': ('copper_loss', 'inverter_loss', 'winding_heating', 'saturation'),
    'iron': ('iron_loss',),
    'field': ('field_weakening',),
    'idle': ('idle',),
    'bus': ('line_resistance', 'regeneration_efficiency', 'regeneration_limit'),
    'motion': ('rotor_inertia', 'spring'),
    'cogging': ('cogging',),
}
KINDS: Final[Mapping[str, str]] = {name: kind for kind, names in _NAMES.items() for name in names}
DEPARTURES: Final[Mapping[str, Mapping[str, float]]] = {
    'friction': {
        'speed': 0.2,
        'load': 0.1,
        'direction': 0.1,
        'quadrant': 0.1,
        'time': 0.1,
        'low': 0.15,
    },
    # Iron loss and it bend to one another.
    'viscous': {'speed': 0.2, 'load': 0.05, 'direction': 0.05, 'quadrant': 0.05, 'time': 0.1},
    # By time, as a winding warms unseen.
    'copper': {'load': 0.1, 'direction': 0.03, 'quadrant': 0.03, 'time': 0.05, 'saturation': 0.1},
    'iron': {'speed': 0.2, 'load': 0.1, 'direction': 0.05, 'quadrant': 0.05, 'time': 0.05},
    'field': {'speed': 0.2, 'load': 0.1, 'direction': 0.05, 'quadrant': 0.05, 'time': 0.05},
    'idle': {'speed': 0.02, 'load': 0.02, 'time': 0.05},
    'bus': {'speed': 0.1, 'load': 0.1, 'direction': 0.1, 'quadrant': 0.1},
    'motion': {'speed': 0.05, 'load': 0.05, 'direction': 0.05, 'quadrant': 0.05},
    'cogging': {'speed': 0.05, 'load': 0.1, 'direction': 0.05, 'quadrant': 0.05},
    'shaft': {'load': 0.01, 'direction': 0.01, 'quadrant': 0.01},
    'other': {'speed': 0.1, 'load': 0.1, 'direction': 0.1, 'quadrant': 0.1, 'time': 0.05},
}
"""Spreads by form: exponents of speed and load, and shares of the effect's own power."""
ALIKE: Final = 0.5  # share of a formula's error that drives of one robot have in common
BLOCK: Final = 2.0  # s
LEAST_TO_JUDGE: Final = 4 * BLOCK  # s: the noise's weights are those of blocks
ALL_SEARCHED: Final = 6  # drives of a robot whose sets are searched on all, with one bus
SEARCHED: Final = 4  # the same, of more drives; the others take the best set
TRIED: Final = 2  # neighbours of a set, by each screening, that are judged at their own point
PAIRS: Final = 3  # the same of sets of two effects more
WORTH: Final = 0.5  # nats, of a further effect
STEPS: Final = 9
NAMED: Final = 0.95
DOUBTED: Final = 0.9  # at most, where an effect hardly lowers the held-out error
MIMICS: Final = 1.0
"""
Size of an effect over the discrepancy, W rms over W rms, at which its evidence counts half.

Each by what known effects cannot take over. What no formula explains can be mistaken for an effect
that explains less.
"""
TOLD_APART: Final = 0.7
"""
The same size from which an effect of usual prior is named, however long the recording is.

With 0.5, 5 of 18 names were false on 51 true plants, most of them with errors of sensors, and 1 of
23 on the 40 drives of others; with 0.7, 1 of 11 and none of 20 (docs/results/reliability.md).
"""
MISFIT: Final = 0.25
"""
Relative error of a coefficient whose effect's own power is what no effect of its set takes over.

With the tails of Student's t of 2 degrees of freedom. Learned on plants of seeds 51 to 181 and
401; on others, 95 % intervals hold the truth in 0.96 (docs/results/reliability.md).
"""
OFF: Final = 0.02
"""Error of a scale or gain from which it is off: beyond a good sensor's."""
SENSORS_OFF: Final = 0.25  # share of sensors whose error is more than that of a good one
MOST_SECONDS: Final = 90.0  # of a robot's recordings that are judged: 150 s named the same
