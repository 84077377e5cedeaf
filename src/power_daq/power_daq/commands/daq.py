"""`ros2 run power_daq daq`: measure drives on a CAN bus or EtherCAT terminals."""

import sys
from collections.abc import Sequence

from wattwalk_core.command import command, command_parser, own_arguments
from wattwalk_core.errors import InputError
from wattwalk_core.quoting import quoted

_EXAMPLE = """
example, with the simulated robot:
  ros2 run power_daq daq --ros-args -p interface:=unixsocket -p channel:=/tmp/drives
example, ODrives on CAN (docs/how-to/own_bus.md), by the node numbers of their drives:
  ros2 run power_daq daq --bus odrive --drives hip=0 knee=1
example, on hardware:
  ros2 run power_daq daq --ros-args -p interface:=socketcan -p channel:=can0 \\
      -p dbc:=robot.dbc -p mapping:=robot.yaml
example, EtherCAT terminals (as root):
  ros2 run power_daq daq --ros-args -p interface:=ethercat -p channel:=eth1 \\
      -p mapping:=ethercat.yaml
"""


@command
def main(args: Sequence[str] | None = None) -> int:
    """Run the node until Ctrl-C; 2 for bad parameters, 1 for a failed device."""
    parser = command_parser(
        'power_daq daq',
        'Publishes the supply of each drive at 1 kHz and joint states at 400 Hz, '
        'from a CAN FD bus; or the supply alone, from EtherCAT terminals.',
        _EXAMPLE,
    )
    parser.add_argument('--bus', metavar='NAME', help='ready bus description: odrive, moteus')
    parser.add_argument(
        '--drives', nargs='+', metavar='DRIVE=NODE', help='node numbers of its drives'
    )
    arguments = sys.argv[1:] if args is None else list(args)
    options = parser.parse_args(own_arguments(arguments))
    arguments += ['--ros-args', *_parameter('bus', options.bus)]
    arguments += _parameter('drives', options.drives and ','.join(options.drives))

    from wattwalk_core.nodes.running import run_node

    from power_daq.nodes.daq import DaqNode

    return run_node(DaqNode, arguments)


def _parameter(name: str, value: str | None) -> list[str]:
    """Return the ROS arguments that set a parameter to text, none for None."""
    if value is None:
        return []
    if not value.isprintable() or set(value) & set('\'"\\'):
        raise InputError(f'--{name} {quoted(value)}: expected names without quotes')
    return ['-p', f"{name}:='{value}'"]
