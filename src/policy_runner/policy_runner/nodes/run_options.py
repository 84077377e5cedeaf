"""The command line of the policy runner."""

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import wraps

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.errors import InputError

from policy_runner.policies.by_name import POLICIES
from policy_runner.policies.velocity_commands import RandomCommands, SteadyCommand

__all__ = ['InputError', 'Options', 'command', 'parse']


@dataclass(frozen=True)
class Options:
    """What the user asked for; InputError for what cannot be."""

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
        """Velocity commands by time since walking began; None for those of cmd_vel."""
        if self.random_commands:
            return RandomCommands(max(self.seed, 0))
        try:
            return None if self.velocity is None else SteadyCommand.parse(self.velocity)
        except ValueError as error:
            raise InputError(f'--velocity: {error}') from None


def parse(arguments: Sequence[str]) -> Options:
    """Read the arguments, ROS ones removed; SystemExit 2 for unknown ones."""
    parser = argparse.ArgumentParser(
        prog='ros2 run policy_runner run',
        description='Run a walking policy on the robot, safely. It waits for the service start.',
        epilog='example: ros2 run policy_runner run --policy pmp --start --velocity=0.6,0,0',
    )
    parser.add_argument(
        '--policy', default='trot', help=f'{", ".join(POLICIES)}, a folder or a TorchScript file'
    )
    parser.add_argument(
        '--start', action='store_true', help='stand up as soon as the robot is heard'
    )
    parser.add_argument(
        '--restart-after',
        type=float,
        default=0.0,
        metavar='S',
        help='after a fault, start again once inputs were sound for S s; 0: never',
    )
    parser.add_argument(
        '--random-commands', action='store_true', help='walk about instead of following cmd_vel'
    )
    parser.add_argument(
        '--velocity',
        metavar='VX,VY,YAW',
        help='hold it (m/s, m/s, rad/s) instead of following cmd_vel',
    )
    parser.add_argument('--seed', type=int, default=0, help='of the random commands')
    parser.add_argument(
        '--trust-code',
        action='store_true',
        help='run TorchScript files: they are code, which may do anything; folders are not',
    )
    return Options(**vars(parser.parse_args(list(arguments))))


def command(
    body: Callable[[Sequence[str]], int | None],
) -> Callable[[Sequence[str] | None], int]:
    """Turn a function of the arguments into an entry point: 2 and one line for InputError."""

    @wraps(body)
    def main(args: Sequence[str] | None = None) -> int:
        try:
            return body(sys.argv[1:] if args is None else args) or 0
        except InputError as error:
            print(f'policy_runner: {error}', file=sys.stderr)
            return 2

    return main
