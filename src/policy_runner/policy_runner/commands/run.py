"""`ros2 run policy_runner run`: run a walking policy on the robot, safely."""

import sys
from argparse import ArgumentParser
from collections.abc import Sequence

from wattwalk_core.command import Arguments, entry_point, own_arguments

from policy_runner.nodes.run_options import ABOUT, Options
from policy_runner.policies.by_name import POLICIES, load_policy


@entry_point(
    'policy_runner.nodes.run:run',
    'Run a walking policy on the robot, safely. It waits for the service start.',
    'example: ros2 run policy_runner run --policy pmp --start --velocity=0.6,0,0',
    name='run',
)
def main(parser: ArgumentParser, args: Arguments) -> tuple[Options, Sequence[str]]:
    add = parser.add_argument
    policies = f'{", ".join(POLICIES)}, a folder or a TorchScript file'
    add('--policy', default='trot', help=policies)
    add('--start', action='store_true', help=ABOUT['start'])
    add('--restart-after', type=float, default=0.0, metavar='S', help=ABOUT['restart_after'])
    add('--random-commands', action='store_true', help=ABOUT['random_commands'])
    add('--velocity', metavar='VX,VY,YAW', help=ABOUT['velocity'])
    add('--seed', type=int, default=0, help=ABOUT['seed'])
    add('--trust-code', action='store_true', help=ABOUT['trust_code'])
    arguments = sys.argv[1:] if args is None else list(args)
    options = Options(**vars(parser.parse_args(own_arguments(arguments))))
    load_policy(options.policy, trust_code=options.trust_code)
    return options, arguments
