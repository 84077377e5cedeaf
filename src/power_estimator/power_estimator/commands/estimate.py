"""`ros2 run power_estimator estimate`: the power of every drive, live."""

import sys
from collections.abc import Sequence

from wattwalk_core.command import command, command_parser, own_arguments

_EXAMPLE = """
example, with a network trained before:
  ros2 run power_estimator estimate --ros-args -p model:=ppn:runs/first
example, against the measurement, shown on diagnostics:
  ros2 run power_estimator estimate --ros-args -p model:=ppn:runs/first -p compare:=true
"""


@command
def main(args: Sequence[str] | None = None) -> int:
    """Run the node until Ctrl-C; 2 for bad parameters or a model that cannot be loaded."""
    parser = command_parser(
        'power_estimator estimate',
        'Estimates the electrical power of every drive at 50 Hz from joint_states '
        'and joint_commands.',
        _EXAMPLE,
    )
    arguments = sys.argv[1:] if args is None else list(args)
    parser.parse_args(own_arguments(arguments))

    from wattwalk_core.nodes.running import run_node

    from power_estimator.live.node import PowerEstimator

    return run_node(PowerEstimator, arguments)
