"""Gaits by name or file."""

import os
from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Any, Final

from policy_runner.policies.gait_phase import CADENCE_ADAPTATION
from policy_runner.policies.trot_gait import TROTS, GaitTable, TrotConfig
from wattwalk_core.errors import InputError
from wattwalk_core.schema import Printable, Quantity, read, schema

from policy_training.config import TrainingConfig, gait_names, gait_path

RANGES: Final[Mapping[str, tuple[float, float]]] = {
    'frequency': (1.0, 2.4),
    'frequency_per_speed': (0.0, 1.2),
    'stance_speed': (0.6, 1.2),
    'duty': (0.52, 0.7),
    'height': (0.48, 0.61),
    'swing_height': (0.015, 0.09),
    'foot_x': (0.26, 0.44),
    'foot_y': (0.13, 0.30),
    'damping': (1.0, 4.5),
    'urgent_duty': (0.5, 0.65),
    'urgent_height': (0.48, 0.60),
    'urgent_swing_height': (0.04, 0.14),
    'urgent_foot_x': (0.30, 0.46),
    'urgent_foot_y': (0.22, 0.36),
}
"""What a file may change, lowest and highest."""
_CLOCK: Final = ('frequency', 'frequency_per_speed')


Values = dict[str, Annotated[float, Quantity(-1e3, 1e3)]]


@schema
class CommandGait:
    """Own values of a gait at a velocity command: vx, vy in m/s, yaw rate in rad/s."""

    command: tuple[
        Annotated[float, Quantity(-3.0, 3.0)],
        Annotated[float, Quantity(-3.0, 3.0)],
        Annotated[float, Quantity(-3.0, 3.0)],
    ]
    values: Values


@schema
class GaitFile:
    """A gait as a change of a named one.

    values: entries of `TrotConfig` by name. by_command: what differs at two or more commands,
    between which gaits are blended. found: what the search for it measured, for people.
    """

    base: Annotated[str, Printable(1)]
    values: Values
    by_command: tuple[CommandGait, ...] = ()
    found: dict[str, Any] | None = None

    def __post_init__(self) -> None:
        if self.base not in TROTS:
            raise InputError(f'base is {self.base!r}; it must be one of {", ".join(TROTS)}')
        for values in (self.values, *(own.values for own in self.by_command)):
            unknown = next((name for name in values if name not in RANGES), None)
            if unknown is not None:
                raise InputError(f'values has {unknown!r}; a gait has {", ".join(RANGES)}')
        for own in self.by_command:
            clock = next((name for name in own.values if name in _CLOCK), None)
            if clock is not None:
                raise InputError(
                    f'by_command has {clock!r}; give it once in values, for all commands'
                )

    def gait(self, own: Mapping[str, float] | None = None) -> TrotConfig:
        """Return the gait, or that of a command by its own values."""
        return replace(TROTS[self.base], **(self.values | dict(own or {})))  # type: ignore[arg-type]


def load_gait(source: str) -> TrotConfig:
    """Return a gait by name or from a file; InputError names what is missing or out of range."""
    return TROTS[source] if source in TROTS else _read(source)[0]


def load_gait_table(source: str) -> GaitTable | None:
    """Return the gaits by command of a file, None for a gait that has none; InputError so."""
    return None if source in TROTS else _read(source)[1]


def _read(source: str) -> tuple[TrotConfig, GaitTable | None]:
    path = gait_path(source)
    if not os.path.isfile(path):
        raise InputError(
            f'no gait {source!r}; there are {", ".join(gait_names())}, or give a file'
        )
    found = read(GaitFile, path, 'gait')
    try:
        if not found.by_command:
            return found.gait(), None
        commands = tuple((x, y, yaw) for x, y, yaw in (own.command for own in found.by_command))
        gaits = tuple(found.gait(own.values) for own in found.by_command)
        return found.gait(), GaitTable(commands, gaits)
    except InputError as error:
        raise InputError(f'gait {path}: {error}') from None


def with_clock_of_gait(config: TrainingConfig) -> TrainingConfig:
    """Return a config whose gait clock is that of the gait it imitates, if a file gives it."""
    if config.imitation.gait in TROTS:
        return config
    gait = load_gait(config.imitation.gait)
    return config.with_values(
        {
            'stride_frequency': gait.frequency,
            'frequency_per_speed': gait.frequency_per_speed,
            'cadence_adaptation': gait.cadence_adaptation or CADENCE_ADAPTATION,
        }
    )
