"""`ros2 run sim_bridge sim`: simulate the robot in real time, or record it offline."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from policy_runner.policies.by_name import POLICIES, load_policy
from wattwalk_core.command import command, command_parser, own_arguments
from wattwalk_core.errors import InputError

from sim_bridge.plant.parameters import Plant
from sim_bridge.plant.terrain import TERRAINS

_EPILOG = """\
Without --offline this is the node `sim_bridge`: the plant in real time behind a CAN bus. Its
settings are ROS parameters: plant, unit, terrain, seed, world (anymal_c or bench), joint, inertia,
mass and length of the pendulum that the bench's drive swings,
interface (unixsocket, virtual, socketcan), channel, dbc, mapping, publish_clock, reset_after_fall,
push_velocity, push_direction. Services: push, reset.

examples:
  ros2 run sim_bridge sim --ros-args -p channel:=/tmp/wattwalk.sock
  ros2 run sim_bridge sim --offline --seed 1 --duration 60 -o bags/walk --pushes
  ros2 run sim_bridge sim --offline --velocity=0,0,0.7 --duration 30 -o bags/turn
"""


def parse(args: Sequence[str]) -> argparse.Namespace:
    """Return the options of the command from its own arguments."""
    parser = command_parser(
        'sim_bridge sim',
        'The simulated robot, its drives and their power meter.',
        _EPILOG,
    )
    add = parser.add_argument
    add('--offline', action='store_true', help='write a bag as fast as the machine can')
    offline = parser.add_argument_group('with --offline')
    add = offline.add_argument
    add('--seed', type=int, default=0, help='of commands, noise, terrain and pushes')
    add('--duration', type=float, default=60.0, metavar='S', help='seconds to simulate')
    add('-o', '--output', type=Path, metavar='BAG', help='folder of the bag to write')
    add('--plant', default='anymal_c', metavar='FILE', help='plant file, or a shipped plant')
    add('--unit', type=int, metavar='N', help='draw the spread of another unit of the robot')
    add('--terrain', choices=TERRAINS, default='flat')
    add('--controller', default='trot', help=f'{", ".join(POLICIES)}, stand, or a policy folder')
    add('--trust-code', action='store_true', help='run TorchScript files, which are code')
    add('--velocity', metavar='VX,VY,YAW', help='hold it (m/s, m/s, rad/s) instead of random ones')
    add('--pushes', action='store_true', help='push the robot every few seconds')
    add('--drives', metavar='A,B', help='meter only these drives, such as LF_KFE,RF_KFE')
    add('--overwrite', action='store_true', help='replace a bag that is there')
    return parser.parse_args(args)


def load_plant(source: str, unit: int | None) -> Plant:
    """Return a plant or, unless None, a unit of it; InputError for an unknown one."""
    plant = Plant.load(source)
    return plant if unit is None else plant.unit(unit)


@command
def main(args: Sequence[str] | None = None) -> int:
    """Run the node until Ctrl-C, or with --offline write a bag; 2 for bad input."""
    arguments = sys.argv[1:] if args is None else list(args)
    options = parse(own_arguments(arguments))
    if options.offline:
        return _offline(options)

    import gc

    from wattwalk_core.nodes.running import run_node

    from sim_bridge.live.node import SimNode

    def make() -> SimNode:
        node = SimNode()
        gc.freeze()
        return node

    return run_node(make, arguments)


def _offline(options: argparse.Namespace) -> int:
    if options.output is None:
        raise InputError('--offline needs -o BAG, the folder of the bag to write')
    names = ('duration', 'seed', 'controller', 'terrain', 'pushes', 'trust_code', 'overwrite')
    given = {name: getattr(options, name) for name in names}
    given['drives'] = None if options.drives is None else tuple(options.drives.split(','))
    given['velocity'] = _velocity(options.velocity)
    plant = load_plant(options.plant, options.unit)

    if options.controller != 'stand':
        load_policy(options.controller, trust_code=options.trust_code)

    from sim_bridge.offline.run import run_offline

    path = run_offline(options.output, plant=plant, progress=True, **given)
    print(f'wrote {path}')
    return 0


def _velocity(text: str | None) -> tuple[float, ...] | None:
    try:
        return None if text is None else tuple(float(part) for part in text.split(','))
    except ValueError:
        raise InputError(f'--velocity is {text!r}; expected VX,VY,YAW such as 0,0,0.8') from None
