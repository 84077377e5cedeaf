"""`ros2 run power_daq watch`: show a running measurement in the terminal."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from wattwalk_core.command import command, command_parser, own_arguments
from wattwalk_core.errors import InputError

_EXAMPLE = """
On a terminal it is a screen of 80 columns or more, twice a second; in a pipe or a file it is a
line a second. It only listens, so it can be started and ended at any time.

examples:
  ros2 run power_daq watch
  ros2 run power_daq watch --duration 10 --save now.svg
  ros2 run power_daq watch > watch.log
"""


@command
def main(args: Sequence[str] | None = None) -> None:
    """Watch until Ctrl-C or the end of the duration; 2 for bad input."""
    arguments = sys.argv[1:] if args is None else list(args)
    options = _parse(arguments)

    from wattwalk_core.nodes.running import run_node

    from power_daq.monitor.terminal import Terminal
    from power_daq.nodes.watch import WatchNode

    terminal = Terminal()

    def make() -> WatchNode:
        node = WatchNode(terminal.show, terminal.period, options.duration)
        terminal.start()
        return node

    try:
        run_node(make, arguments)
    finally:
        terminal.stop()
    if options.save is not None:
        terminal.save(options.save)
        print(options.save)


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    parser = command_parser(
        'power_daq watch',
        'Shows what a running measurement measures: watts of each drive, the '
        'supply, energy, estimates, losses, clocks, the bus and the recorder.',
        _EXAMPLE,
    )
    parser.add_argument('--duration', type=float, default=0.0, metavar='S', help='end after that')
    parser.add_argument(
        '--save', type=Path, metavar='F.svg', help='at the end, write the last view as a picture'
    )
    options = parser.parse_args(own_arguments(arguments))
    if not options.duration >= 0:
        raise InputError(f'--duration is {options.duration:g} s; expected a positive number')
    if options.save is not None and options.save.suffix != '.svg':
        raise InputError(f'--save is {options.save}; expected a name that ends with .svg')
    return options
