"""Options of the policy runner."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.errors import InputError

from policy_runner.policies.velocity_commands import RandomCommands, SteadyCommand


@dataclass(frozen=True)
class Options:
    """Options of the runner; InputError for values out of range."""

    policy: str = 'trot'
    start: bool = False
    restart_after: float = 0.0
    random_commands: bool = False
    velocity: str | None = None
    seed: int = 0
    trust_code: bool = False

    def __post_init__(self) -> None:
        if not 0.0 <= self.restart_after < 3600.0:
            raise InputError(
                f'--restart-after is {self.restart_after}; give 0 (never) to 3600 seconds'
            )
        if self.random_commands and self.velocity is not None:
            raise InputError('--random-commands and --velocity exclude each other')
        self.source()
        if self.seed < 0:
            raise InputError(f'--seed is {self.seed}; give 0 or more')

    def source(self) -> Callable[[float], NDArray[np.float64]] | None:
        """Return velocity commands by time since walking began; None for those of cmd_vel."""
        if self.random_commands:
            return RandomCommands(max(self.seed, 0))
        try:
            return None if self.velocity is None else SteadyCommand.parse(self.velocity)
        except ValueError as error:
            raise InputError(f'--velocity: {error}') from None
