"""Figures of `diagnostics` on a drive's torque and velocity, which the recorder reads."""

from collections.abc import Mapping, Sequence
from typing import Final

TORQUE_AT: Final = 'torque of '
TORQUE_UNIT: Final = 'torque unit of '
VELOCITY: Final = 'velocity of '


def torque_figures(
    at: Mapping[str, str], unit: Mapping[str, str], derived: Sequence[str] = ()
) -> dict[str, str]:
    """
    Return the figures of drives, by name: torque at joint or motor, and in A.

    derived: drives whose velocity is the rate of their position.
    """
    figures = {f'{TORQUE_AT}{drive}': where for drive, where in at.items()}
    figures |= {f'{TORQUE_UNIT}{drive}': name for drive, name in unit.items()}
    return figures | {f'{VELOCITY}{drive}': 'rate of position' for drive in derived}
