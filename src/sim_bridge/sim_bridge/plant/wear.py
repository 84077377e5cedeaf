"""Wear of single drives: factors on the parameters of an effect, and errors of the meter."""

from collections.abc import Mapping, Sequence
from typing import Final

from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError, quoted

WEARS: Final[Mapping[str, tuple[str, ...]]] = {
    'coulomb_friction': ('coulomb',),
    'viscous_friction': ('viscous', 'output_viscous'),
    'stribeck_friction': ('stribeck',),
    'load_friction': ('load_friction',),
    'copper_loss': ('resistance',),
    'iron_loss': ('hysteresis', 'eddy'),
    'inverter_loss': ('device_drop', 'device_resistance', 'switching_share'),
    'idle': ('idle_power',),
    'line_resistance': ('line_resistance',),
    'cogging': ('cogging',),
    'power_gain': ('current_gain',),
}
"""Parameters of a drive, or of its meter, that a factor multiplies, by the effect's name."""
OFFSET: Final = 'current_offset'  # offset of a current sensor, A, which is added


def check_wear(wear: Mapping[str, Mapping[str, float]]) -> None:
    """Raise InputError for an unknown effect or a value outside its range."""
    for drive, own in wear.items():
        for name, value in own.items():
            if name not in (*WEARS, OFFSET):
                known = ', '.join((*WEARS, OFFSET))
                raise InputError(
                    f'wear.{drive}: unknown effect {quoted(name)}; there can be {known}'
                )
            low, high, unit = (-5.0, 5.0, ' A') if name == OFFSET else (0.0, 10.0, '')
            if not low <= value <= high:
                raise InputError(
                    f'wear.{drive}.{name}: expected {low:g} to {high:g}{unit}, there is {value:g}'
                )


def apply_wear(
    values: dict[str, Floats], drives: Sequence[str], wear: Mapping[str, Mapping[str, float]]
) -> None:
    """Change parameters, [D] by name, in place by the wear of each drive (as of `Plant`)."""
    for index, drive in enumerate(drives):
        for name, value in wear.get(drive, {}).items():
            if name == OFFSET:
                values[OFFSET][index] += value
                continue
            for parameter in WEARS[name]:
                values[parameter][index] *= value
