"""`ros2 run power_daq topics`: republish what a robot's own topics measure."""

import sys
from collections.abc import Sequence
from functools import partial

from wattwalk_core.command import command, command_parser, own_arguments

_EXAMPLE = """
example, ODrives with their own ROS 2 node:
  ros2 run power_daq topics --map ros_odrive
example, a map of yours (docs/how-to/own_bus.md), where the robot has its own joint_states:
  ros2 run power_daq topics --map arm.yaml --ros-args -r __ns:=/measured
"""


@command
def main(args: Sequence[str] | None = None) -> int:
    """Run the node until Ctrl-C; 2 for a map that does not fit the topics."""
    parser = command_parser(
        'power_daq topics',
        'Publishes drive_supply, joint_states and supply from whatever topics a robot has, '
        'by the map of an import.',
        _EXAMPLE,
    )
    parser.add_argument(
        '--map', required=True, metavar='NAME|FILE', help='import map: ready by name, or a file'
    )
    parser.add_argument(
        '--commands', action='store_true', help='publish joint_commands from the map, too'
    )
    arguments = sys.argv[1:] if args is None else list(args)
    options = parser.parse_args(own_arguments(arguments))

    from power_recordings.importing.map_file import load_map
    from wattwalk_core.nodes.running import run_node

    mapping = load_map(options.map)

    from power_daq.nodes.topics import TopicsNode

    where = f'map {options.map}'
    return run_node(partial(TopicsNode, mapping, where, options.commands), arguments)
