"""Figures of `diagnostics` that say which torque a drive's is, and that the recorder reads."""

from collections.abc import Mapping
from typing import Final

TORQUE_AT: Final = 'torque of '
TORQUE_UNIT: Final = 'torque unit of '


def torque_figures(at: Mapping[str, str], unit: Mapping[str, str]) -> dict[str, str]:
    """Return the figures of drives whose torque is at joint or motor, and in A, by drive."""
    figures = {f'{TORQUE_AT}{drive}': where for drive, where in at.items()}
    return figures | {f'{TORQUE_UNIT}{drive}': name for drive, name in unit.items()}
