"""`ros2 run power_daq watch`: show a running measurement in the terminal."""

import argparse

from wattwalk_core.nodes.running import run_node

from power_daq.monitor.screen import Terminal
from power_daq.nodes.watch import WatchNode


def run(options: argparse.Namespace) -> None:
    """Watch until Ctrl-C or the end of the duration; 2 for bad input."""
    terminal = Terminal()

    def make() -> WatchNode:
        node = WatchNode(terminal.show, terminal.period, options.duration, options.battery)
        terminal.start()
        return node

    try:
        run_node(make, options.ros_args)
    finally:
        terminal.stop()
    if options.save is not None:
        terminal.save(options.save)
        print(options.save)
