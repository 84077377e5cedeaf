"""Options of the policy runner."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError

from policy_runner.policies.velocity_commands import RandomCommands, SteadyCommand, parse_velocity

if TYPE_CHECKING:
    from wattwalk_core.nodes.parameters import DeviceParameters  # rclpy, slow to import

_LARGEST_SEED: Final = 2**31 - 1
ABOUT: Final = {
    'start': 'stand up as soon as the robot is heard',
    'restart_after': 'after a fault, start again once inputs were sound for so many s; 0: never',
    'random_commands': 'walk about instead of following cmd_vel',
    'velocity': 'VX,VY,YAW to hold (m/s, m/s, rad/s) instead of following cmd_vel',
    'seed': 'of the random commands',
    'trust_code': 'run TorchScript files: they are code, which may do anything; folders are not',
}
"""Description of each option, which is a parameter of the node by the same name."""


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

    def declared(self, given: 'DeviceParameters') -> 'Options':
        """Declare the options as parameters of a node, these as defaults; return those set."""
        return Options(
            self.policy,
            given.flag('start', self.start, ABOUT['start']),
            given.real('restart_after', self.restart_after, ABOUT['restart_after'], 0.0, 3600.0),
            given.flag('random_commands', self.random_commands, ABOUT['random_commands']),
            given.text('velocity', self.velocity or '', ABOUT['velocity']) or None,
            given.whole('seed', self.seed, ABOUT['seed'], 0, _LARGEST_SEED),
            given.flag('trust_code', self.trust_code, ABOUT['trust_code']),
        )

    def source(self) -> Callable[[float], Floats] | None:
        """Return velocity commands by s of walking; None for cmd_vel. InputError if malformed."""
        if self.random_commands:
            return RandomCommands(max(self.seed, 0))
        return None if self.velocity is None else SteadyCommand(parse_velocity(self.velocity))
