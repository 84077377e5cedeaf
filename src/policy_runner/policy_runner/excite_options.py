"""The command line of `ros2 run policy_runner excite`."""

import argparse
from collections.abc import Sequence
from pathlib import Path

_EPILOG = """\
The motion starts with --start, or on the service start. Services stop and estop end it: drives are
damped, as after every fault, Ctrl-C included. Parameters: rate, stale_after.

Loads are what gravity gives: say with which torque the pendulum (or the hung leg) pulls at a right
angle, and a held torque is the angle at which it pulls as much. --locked: the joint is held fast,
and the drive pushes against it.

exit codes: 0 done, 1 ended by a fault or an emergency stop, 2 bad input, 130 stopped

examples:
  ros2 run policy_runner excite next.yaml --drive LF_KFE
  ros2 run policy_runner excite next.yaml --drive LF_KFE --pendulum 22 --limits limits.yaml --start
"""


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """Read the arguments, ROS ones removed; SystemExit 2 for unknown ones."""
    parser = argparse.ArgumentParser(
        prog='ros2 run policy_runner excite',
        description='Put drives through the segments of a motion file, safely.',
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add('motion', type=Path, metavar='FILE', help='motion/1, from power_lab diagnose --motion')
    add(
        '--drive',
        action='append',
        metavar='NAME',
        help='drive to move, may be repeated; default: the first that the motion names. '
        'All others hold where they are',
    )
    add('--start', action='store_true', help='start as soon as joint_states are sound')
    add('--pendulum', type=float, default=0.0, metavar='NM', help='its pull at a right angle')
    add('--hanging', type=float, default=0.0, metavar='RAD', help='where it hangs; default 0')
    add('--locked', action='store_true', help='the joint is held fast')
    add('--limits', type=Path, metavar='FILE', help='joint_limits/1; default: those of ANYmal C')
    return parser.parse_args(list(arguments))
