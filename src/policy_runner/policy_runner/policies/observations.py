"""Observations of learned policies: one definition for training and for the robot."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Annotated, Any, ClassVar, Final

import numpy as np
from wattwalk_core.arrays import Floats, Singles
from wattwalk_core.errors import InputError
from wattwalk_core.schema import Quantity, schema

SIZES: Final[Mapping[str, int]] = {
    'base_velocity': 3,
    'angular_velocity': 3,
    'gravity': 3,
    'command': 3,
    'joint_position': 12,
    'joint_velocity': 12,
    'last_action': 12,
}
"""
Number of values of each term. base_velocity m/s, angular_velocity rad/s and gravity (unit vector)
are in the base's frame; command is vx, vy in m/s and yaw rate in rad/s; joint_position is relative
to the policy's default pose, rad; joint_velocity rad/s; last_action is the network's previous
output, unscaled. Joints are in the policy's order.
"""


_LARGEST: Final = 1e6


@schema
class ObservationTerm:
    """One term of an observation; scale is one number, or one per value."""

    name: str
    scale: float | tuple[float, ...] = 1.0

    def __post_init__(self) -> None:
        if self.name not in SIZES:
            raise InputError(f'no observation {self.name!r}; there are {", ".join(SIZES)}')
        if np.size(self.scale) not in (1, self.size):
            raise InputError(
                f'scale of observation {self.name} is {self.scale}; give one number, '
                f'or {self.size}'
            )
        if np.abs(self.scale).max() > _LARGEST:
            raise InputError(f'scale of observation {self.name} is {self.scale}; at most 1e6')

    @property
    def size(self) -> int:
        """Number of values."""
        return SIZES[self.name]


@schema
class Observation:
    """Terms in the order of the network's inputs, scaled, then clipped to ±clip.

    command_rate_limit: of the velocity command that the policy is given, m/s², m/s² and rad/s²;
    empty for none.
    """

    RENAMED: ClassVar = {'command_slew': 'command_rate_limit'}

    terms: tuple[ObservationTerm, ...]
    clip: Annotated[float, Quantity(1e-3, 1e6)] = 100.0
    command_rate_limit: tuple[Annotated[float, Quantity(0.1, 100.0, 'm/s² or rad/s²')], ...] = ()

    def __post_init__(self) -> None:
        if not self.names or len(set(self.names)) != len(self.names):
            raise InputError(f'terms are {list(self.names)}; name each once, and at least one')
        if len(self.command_rate_limit) not in (0, 3):
            raise InputError(
                f'command_rate_limit is {list(self.command_rate_limit)}; expected three numbers '
                '(m/s², m/s², rad/s²)'
            )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the terms in order."""
        return tuple(term.name for term in self.terms)

    @property
    def size(self) -> int:
        """Number of values of all terms."""
        return sum(term.size for term in self.terms)

    def part(self, name: str) -> slice:
        """Return the place of a term in the observation; KeyError if it has none of that name."""
        start = 0
        for term in self.terms:
            if term.name == name:
                return slice(start, start + term.size)
            start += term.size
        raise KeyError(name)

    def scales(self) -> Floats:
        """Return the factor of each value [size]."""
        return np.concatenate([np.broadcast_to(term.scale, term.size) for term in self.terms])

    def assemble(self, values: Mapping[str, Floats]) -> Singles:
        """Return an observation [..., size] of terms in SI units, by name [..., size of it]."""
        joined = np.concatenate([values[name] for name in self.names], axis=-1) * self.scales()
        return np.clip(joined, -self.clip, self.clip).astype(np.float32)

    def content(self) -> dict[str, Any]:
        """Return keys and values as policy.yaml holds them, empty ones left out."""
        found: dict[str, Any] = asdict(self)  # type: ignore[call-overload]
        lists = {key: list(value) for key, value in found.items() if isinstance(value, tuple)}
        return {key: value for key, value in (found | lists).items() if value != []}


STANDARD: Final = Observation(
    (
        ObservationTerm('base_velocity', 2.0),
        ObservationTerm('angular_velocity', 0.25),
        ObservationTerm('gravity'),
        ObservationTerm('command', (2.0, 2.0, 0.25)),
        ObservationTerm('joint_position'),
        ObservationTerm('joint_velocity', 0.05),
        ObservationTerm('last_action'),
    )
)
"""The 48 values of legged_gym's flat ANYmal, the observation of the paper's baseline [14]."""
