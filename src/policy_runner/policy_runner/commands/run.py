"""`ros2 run policy_runner run`: run a walking policy on the robot, safely."""

import sys
from collections.abc import Sequence

from wattwalk_core.command import command_parser, entry_point, own_arguments

from policy_runner.nodes.run_options import ABOUT, Options
from policy_runner.policies.by_name import POLICIES, load_policy


@entry_point('policy_runner.nodes.run:run')
def main(args: Sequence[str] | None = None) -> tuple[Options, Sequence[str]]:
    """Arguments of run, and those for ROS."""
    arguments = sys.argv[1:] if args is None else list(args)
    options = parse(own_arguments(arguments))
    load_policy(options.policy, trust_code=options.trust_code)
    return options, arguments


def parse(arguments: Sequence[str]) -> Options:
    """Read the arguments, ROS ones removed; SystemExit 2 for unknown ones."""
    parser = command_parser(
        'policy_runner run',
        'Run a walking policy on the robot, safely. It waits for the service start.',
        'example: ros2 run policy_runner run --policy pmp --start --velocity=0.6,0,0',
    )
    add = parser.add_argument
    policies = f'{", ".join(POLICIES)}, a folder or a TorchScript file'
    add('--policy', default='trot', help=policies)
    add('--start', action='store_true', help=ABOUT['start'])
    add('--restart-after', type=float, default=0.0, metavar='S', help=ABOUT['restart_after'])
    add('--random-commands', action='store_true', help=ABOUT['random_commands'])
    add('--velocity', metavar='VX,VY,YAW', help=ABOUT['velocity'])
    add('--seed', type=int, default=0, help=ABOUT['seed'])
    add('--trust-code', action='store_true', help=ABOUT['trust_code'])
    return Options(**vars(parser.parse_args(list(arguments))))
