"""`ros2 run power_daq topics`: republish what a robot's own topics measure."""

import argparse
from functools import partial

from power_recordings.importing.map_file import load_map
from wattwalk_core.nodes.running import run_node

from power_daq.nodes.topics import TopicsNode


def run(options: argparse.Namespace) -> int:
    """Run the node until Ctrl-C; 2 for a map that does not fit the topics."""
    mapping = load_map(options.map)
    where = f'map {options.map}'
    return run_node(partial(TopicsNode, mapping, where, options.commands), options.ros_args)
