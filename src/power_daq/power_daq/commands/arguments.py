"""Arguments of the commands."""

from argparse import ArgumentParser, Namespace
from math import nan
from pathlib import Path

from wattwalk_core.command import Arguments, entry_point, node_options, watt_hours
from wattwalk_core.errors import InputError, quoted

_RECORD = """
example, until Ctrl-C:
  ros2 run power_daq record -o bags/walk_1 --card robot=anymal_c unit=A terrain=flat
example, one minute of two topics:
  ros2 run power_daq record -o bags/leg --duration 60 --topics drive_supply joint_states
"""


@entry_point(
    'power_daq.commands.record:run',
    "Records the suite's topics to a rosbag2 MCAP bag, until Ctrl-C.",
    _RECORD,
)
def record(parser: ArgumentParser, args: Arguments) -> Namespace:
    parser.add_argument(
        '-o', '--output', type=Path, required=True, metavar='BAG', help='new folder of the bag'
    )
    parser.add_argument(
        '--topics', nargs='+', metavar='TOPIC', help='instead of all: NAME or NAME:package/Type'
    )
    parser.add_argument('--duration', type=float, default=0.0, metavar='S', help='stop after that')
    parser.add_argument(
        '--wait', action='store_true', help='count the duration from the first sample of power on'
    )
    parser.add_argument(
        '--card',
        nargs='+',
        action='extend',
        default=[],
        metavar='KEY=VALUE',
        help='robot, unit, drives, controller, calibration, terrain, notes, … for card.yaml',
    )
    options = node_options(parser, args)
    if options.duration < 0:
        raise InputError(f'--duration is {options.duration:g} s; expected a positive number')
    return options


_TOPICS = """
example, ODrives with their own ROS 2 node:
  ros2 run power_daq topics --map ros_odrive
example, a map of yours (docs/how-to/own_bus.md), where the robot has its own joint_states:
  ros2 run power_daq topics --map arm.yaml --ros-args -r __ns:=/measured
"""


@entry_point(
    'power_daq.nodes.topics:run',
    'Publishes drive_supply, joint_states and supply from whatever topics a robot has, '
    'by the map of an import.',
    _TOPICS,
)
def topics(parser: ArgumentParser, args: Arguments) -> Namespace:
    parser.add_argument(
        '--map', required=True, metavar='NAME|FILE', help='import map: ready by name, or a file'
    )
    parser.add_argument(
        '--commands', action='store_true', help='publish joint_commands from the map, too'
    )
    return node_options(parser, args)


_WATCH = """
On a terminal it is a screen of 80 columns or more, twice a second; in a pipe or a file it is a
line a second. It only listens, so it can be started and ended at any time.

examples:
  ros2 run power_daq watch
  ros2 run power_daq watch --battery 650Wh
  ros2 run power_daq watch --duration 10 --save now.svg
  ros2 run power_daq watch > watch.log
"""


@entry_point(
    'power_daq.nodes.watch:run',
    'Shows what a running measurement measures: watts of each drive, the '
    'supply, energy, where the watts of the last ten seconds went, losses, clocks, the bus and '
    'the recorder.',
    _WATCH,
)
def watch(parser: ArgumentParser, args: Arguments) -> Namespace:
    parser.add_argument('--duration', type=float, default=0.0, metavar='S', help='end after that')
    parser.add_argument(
        '--save', type=Path, metavar='F.svg', help='at the end, write the last view as a picture'
    )
    parser.add_argument(
        '--battery',
        type=watt_hours,
        default=nan,
        metavar='907Wh',
        help='energy that the battery holds now: give the hours that are left',
    )
    options = node_options(parser, args)
    if not options.duration >= 0:
        raise InputError(f'--duration is {options.duration:g} s; expected a positive number')
    if options.save is not None and options.save.suffix != '.svg':
        raise InputError(f'--save is {options.save}; expected a name that ends with .svg')
    return options


_DAQ = """
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


@entry_point(
    'power_daq.nodes.daq:run',
    'Publishes the supply of each drive at 1 kHz and joint states at 400 Hz, '
    'from a CAN FD bus; or the supply alone, from EtherCAT terminals.',
    _DAQ,
)
def daq(parser: ArgumentParser, args: Arguments) -> Namespace:
    parser.add_argument('--bus', metavar='NAME', help='ready bus description: odrive, moteus')
    parser.add_argument(
        '--drives', nargs='+', metavar='DRIVE=NODE', help='node numbers of its drives'
    )
    options = node_options(parser, args)
    options.ros_args += ['--ros-args', *_parameter('bus', options.bus)]
    options.ros_args += _parameter('drives', options.drives and ','.join(options.drives))
    return options


def _parameter(name: str, value: str | None) -> list[str]:
    """Return the ROS arguments that set a parameter to text, none for None."""
    if value is None:
        return []
    if not value.isprintable() or set(value) & set('\'"\\'):
        raise InputError(f'--{name} {quoted(value)}: expected names without quotes')
    return ['-p', f"{name}:='{value}'"]


_SUPPLY = """
It only reads, unless switch_output_on is true.

example, an EA PSB 9000:
  ros2 run power_daq supply --ros-args -p host:=192.168.0.42
example, without hardware:
  ros2 run sim_bridge supply_instrument --ros-args -p current:=3.0
  ros2 run power_daq supply --ros-args -p host:=127.0.0.1
the energy counter back to zero:
  ros2 service call /supply/reset_energy std_srvs/srv/Trigger
"""


@entry_point(
    'power_daq.nodes.supply:run',
    'Publishes voltage and current of a bench supply at 100 Hz, from SCPI over '
    'TCP; counts energy and sets it against the drives.',
    _SUPPLY,
)
def supply(parser: ArgumentParser, args: Arguments) -> Namespace:
    return node_options(parser, args)
