"""Load of a drive: a weight on an arm."""

import re
from dataclasses import dataclass
from typing import Final

from wattwalk_core.errors import InputError
from wattwalk_core.physics import GRAVITY

_LOAD: Final = re.compile(r'(?P<mass>[\d.]+) ?kg ?@ ?(?P<length>[\d.]+) ?m')


@dataclass(frozen=True)
class Load:
    """Weight on an arm: mass (kg) at a length (m) from the joint."""

    mass: float
    length: float

    @property
    def pull(self) -> float:
        """Torque of gravity at a right angle, N·m."""
        return GRAVITY * self.mass * self.length

    def __str__(self) -> str:
        return f'{self.mass:g}kg@{self.length:g}m'

    @classmethod
    def of(cls, text: str) -> 'Load':
        """Parse text such as 4kg@0.3m; InputError for anything else."""
        found = _LOAD.fullmatch(text.strip())
        try:
            load = cls(float(found['mass']), float(found['length'])) if found else None
        except ValueError:
            load = None
        if load is None or not (0.0 < load.mass <= 100.0 and 0.0 < load.length <= 3.0):
            raise InputError(f'--load is {text!r}; give such as 4kg@0.3m, up to 100 kg and 3 m')
        return load
