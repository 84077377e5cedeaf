"""`ros2 run sim_bridge sim`: simulate the robot in real time, or record it offline."""

import argparse
import gc

from policy_runner.policies.by_name import load_policy
from policy_runner.policies.velocity_commands import parse_velocity
from wattwalk_core.errors import InputError

from sim_bridge.offline.run import run_offline
from sim_bridge.plant.parameters import Plant


def run(options: argparse.Namespace) -> int:
    """Run the node until Ctrl-C, or with --offline write a bag; return the exit status."""
    if options.offline:
        return _offline(options)

    from wattwalk_core.nodes.running import run_node  # rclpy: a recording does without it

    from sim_bridge.live.node import SimNode

    def make() -> SimNode:
        node = SimNode()
        gc.freeze()
        return node

    return run_node(make, options.ros_args)


def _offline(options: argparse.Namespace) -> int:
    if options.output is None:
        raise InputError('--offline needs -o BAG, the folder of the bag to write')
    names = ('duration', 'seed', 'controller', 'terrain', 'pushes', 'trust_code', 'overwrite')
    given = {name: getattr(options, name) for name in names}
    given['drives'] = None if options.drives is None else tuple(options.drives.split(','))
    if options.velocity is not None:
        given['velocity'] = parse_velocity(options.velocity, '--velocity')
    plant = Plant.load(options.plant, options.unit)
    if options.controller != 'stand':
        load_policy(options.controller, trust_code=options.trust_code)
    path = run_offline(options.output, plant=plant, progress=True, **given)
    print(f'wrote {path}')
    return 0
