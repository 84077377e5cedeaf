"""`ros2 run power_daq supply`: measure the supply of a robot by SCPI."""

import sys
from collections.abc import Sequence

from wattwalk_core.command import command, command_parser, own_arguments

_EXAMPLE = """
It only reads, unless switch_output_on is true.

example, an EA PSB 9000:
  ros2 run power_daq supply --ros-args -p host:=192.168.0.42
example, without hardware:
  ros2 run sim_bridge supply_instrument --ros-args -p current:=3.0
  ros2 run power_daq supply --ros-args -p host:=127.0.0.1
the energy counter back to zero:
  ros2 service call /reset_energy std_srvs/srv/Trigger
"""


@command
def main(args: Sequence[str] | None = None) -> int:
    """Run the node until Ctrl-C; 2 for bad parameters or a refused output."""
    parser = command_parser(
        'power_daq supply',
        'Publishes voltage and current of a bench supply at 100 Hz, from SCPI over '
        'TCP; counts energy and sets it against the drives.',
        _EXAMPLE,
    )
    arguments = sys.argv[1:] if args is None else list(args)
    parser.parse_args(own_arguments(arguments))

    from wattwalk_core.nodes.running import run_node

    from power_daq.nodes.supply import SupplyNode

    return run_node(SupplyNode, arguments)
