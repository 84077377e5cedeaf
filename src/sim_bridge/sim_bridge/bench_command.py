"""`ros2 run sim_bridge bench`: a bag of one drive in a reference motion on a stand."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from power_daq.cli import command
from rclpy.utilities import remove_ros_args

from sim_bridge.motions import MODES, SHAPES, Motion
from sim_bridge.offline import OfflineRun, write_bench_bag
from sim_bridge.robot import JOINT_NAMES
from sim_bridge.sim_command import load_plant
from sim_bridge.world import Stand, stand_world


def _epilog() -> str:
    motions = '\n'.join(f'  {name:8}{shape.text}' for name, shape in SHAPES.items())
    modes = '\n'.join(
        f'  {name:10}amplitude up to {most:g} {unit}, {usual:g} if not given'
        for name, (usual, most, unit) in MODES.items()
    )
    return f"""motions:
{motions}

modes:
{modes}

examples:
  ros2 run sim_bridge bench sine -o bags/sine
  ros2 run sim_bridge bench ladder --mode velocity --duration 40 -o bags/ladder
  ros2 run sim_bridge bench square --drive RH_HFE --mass 4 --length 0.4 -o bags/swing
"""


def parse(args: Sequence[str]) -> argparse.Namespace:
    """Options of the command; ROS arguments must be gone from args."""
    parser = argparse.ArgumentParser(
        prog='bench',
        description='Record one simulated drive on a stand, as fast as the machine can.',
        epilog=_epilog(),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add('motion', choices=tuple(SHAPES))
    add('-o', '--output', type=Path, required=True, metavar='BAG', help='folder to write')
    add('--mode', choices=tuple(MODES), default='position')
    add('--amplitude', type=float, metavar='X', help='in the unit of the mode')
    add('--frequency', type=float, metavar='HZ')
    add('--duration', type=float, default=30.0, metavar='S', help='seconds to simulate')
    add('--drive', choices=JOINT_NAMES, default='LF_KFE', metavar='NAME', help='such as LF_KFE')
    add('--inertia', type=float, default=0.02, metavar='J', help='of the disc it turns, kg·m²')
    add('--mass', type=float, default=0.0, metavar='M', help='of the pendulum on it, kg')
    add('--length', type=float, default=0.3, metavar='L', help='of the pendulum, m')
    add('--seed', type=int, default=0, help='of the noise')
    add('--plant', default='anymal_c', metavar='FILE', help='plant file, or a shipped plant')
    add('--unit', type=int, metavar='N', help='draw the spread of another unit')
    add('--overwrite', action='store_true', help='replace a bag that is there')
    return parser.parse_args(args)


@command
def main(args: Sequence[str] | None = None) -> int:
    """Write the bag that the arguments ask for."""
    given = list(sys.argv if args is None else ['bench', *args])
    options = parse(remove_ros_args(given)[1:])
    plant = load_plant(options.plant, options.unit)
    motion = Motion(options.motion, options.mode, options.amplitude, options.frequency)
    world = stand_world(options.drive, Stand(options.inertia, options.mass, options.length))
    run = OfflineRun(plant, world, motion, duration=options.duration, seed=options.seed)
    write_bench_bag(
        options.output,
        run,
        unit=str(plant.unit_number),
        controller=motion.name,
        notes='simulated drive on a stand',
        seed=options.seed,
        plant=plant.name,
        overwrite=options.overwrite,
    )
    print(f'wrote {options.output}')
    return 0
