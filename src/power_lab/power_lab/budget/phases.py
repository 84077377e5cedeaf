"""Phases of motion: driving, braking and rest of a drive, stance and swing of its leg."""

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.arrays import Bools, Floats

PHASES: Final = ('all', 'driving', 'braking', 'rest', 'stance', 'swing')


def phase_masks(
    torque: Floats, velocity: Floats, standstill: Floats, feet: NDArray[np.str_] | None
) -> Mapping[str, Bools]:
    """
    Rows of each phase [N, D], from N·m and rad/s at 50 Hz; feet: words by leg, '' for none.

    At rest the speed is below standstill [D], whatever the load.
    """
    rest = np.abs(velocity) < standstill
    drives = torque * velocity >= 0.0
    found = {
        'all': np.ones(torque.shape, bool),
        'driving': drives & ~rest,
        'braking': ~drives & ~rest,
        'rest': rest,
    }
    if feet is not None:
        found |= {word: feet == word for word in ('stance', 'swing')}
    return found
