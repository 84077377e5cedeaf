"""Trots by velocity command, blended for the commands in between."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.errors import InputError

from policy_runner.policies.trot_gait import TrotConfig

Floats = NDArray[np.float64]

BLENDED: Final = ('stance_speed', 'swing_height', 'urgent_swing_height', 'damping')
"""Entries of `TrotConfig` that follow the command, beside duty, height and footholds."""
_SIZE: Final = np.array([0.5, 0.4, 0.8])  # m/s, m/s, rad/s that count alike
_SOFTEST: Final = 0.02  # squared distance below which a gait rules alone


@dataclass(frozen=True)
class GaitTable:
    """
    A trot for each of K velocity commands.

    Their frequency is not blended: a policy's gait clock follows one line over speed. Commands
    mean their mirror images too. InputError for fewer than two.
    """

    commands: tuple[tuple[float, float, float], ...]  # vx, vy in m/s, yaw rate in rad/s
    gaits: tuple[TrotConfig, ...]

    def __post_init__(self) -> None:
        if len(self.commands) < 2 or len(self.commands) != len(self.gaits):
            raise InputError(
                f'a table of gaits has {len(self.commands)} commands and {len(self.gaits)} gaits; '
                'give two or more, and as many of both'
            )

    def weights(self, command: Floats) -> Floats:
        """Return the share of each gait [N, K] at commands [N, 3], by inverse distance⁴."""
        away = (np.abs(command)[:, None] - self._places) / _SIZE
        near = 1.0 / np.square(np.square(away).sum(axis=2) + _SOFTEST)
        return np.asarray(near / near.sum(axis=1, keepdims=True))

    @cached_property
    def _places(self) -> Floats:
        return np.abs(np.array(self.commands, np.float64))

    @cached_property
    def values(self) -> dict[str, Floats]:
        """The blended entries of each gait [K]."""
        return {
            name: np.array([getattr(gait, name) for gait in self.gaits], np.float64)
            for name in BLENDED
        }

    @cached_property
    def stances(self) -> tuple[Floats, Floats]:
        """Duty, height, foot_x and foot_y of each gait [K, 4], calm and at full urgency."""
        calm, urgent = (
            np.array([gait.stance(urgency) for gait in self.gaits]) for urgency in (0.0, 1.0)
        )
        return calm, urgent
