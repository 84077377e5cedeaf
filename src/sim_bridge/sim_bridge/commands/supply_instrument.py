"""`ros2 run sim_bridge supply_instrument`: emulate a bench supply on a TCP socket."""

import sys
from collections.abc import Sequence

from wattwalk_core.command import command, command_parser, own_arguments

_EXAMPLE = """
example, a constant load:
  ros2 run sim_bridge supply_instrument --ros-args -p voltage:=48.0 -p current:=3.0
  ros2 run power_daq supply --ros-args -p host:=127.0.0.1
example, what the simulated robot draws (its own supply goes to another topic):
  ros2 run sim_bridge sim --ros-args -r supply:=simulated_supply
  ros2 run sim_bridge supply_instrument
  ros2 run power_daq supply --ros-args -p host:=127.0.0.1
"""


@command
def main(args: Sequence[str] | None = None) -> int:
    """Run the node until Ctrl-C; 2 for bad parameters or a port that is taken."""
    parser = command_parser(
        'sim_bridge supply_instrument',
        'A simulated bench supply that speaks SCPI over TCP, to try power_daq supply '
        'without hardware.',
        _EXAMPLE,
    )
    arguments = sys.argv[1:] if args is None else list(args)
    parser.parse_args(own_arguments(arguments))

    from wattwalk_core.nodes.running import run_node

    from sim_bridge.instruments.supply_node import SupplyInstrumentNode

    return run_node(SupplyInstrumentNode, arguments)
