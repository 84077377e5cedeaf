"""The command line of `ros2 run policy_runner excite`, part of which `bench` shares."""

import argparse
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from wattwalk_core.errors import InputError

from drive_bench.motion.file import MotionFile
from drive_bench.motion.library import MOTIONS, find_motion
from drive_bench.motion.segment_path import Mounting

GRAVITY: Final = 9.81  # m/s²
_LOAD: Final = re.compile(r'(?P<mass>[\d.]+) ?kg ?@ ?(?P<length>[\d.]+) ?m')
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


@dataclass(frozen=True)
class Load:
    """A weight on an arm: mass (kg) at a length (m) from the joint."""

    mass: float
    length: float

    @property
    def pull(self) -> float:
        """Torque of gravity at a right angle, N·m."""
        return GRAVITY * self.mass * self.length

    def __str__(self) -> str:
        return f'{self.mass:g}kg@{self.length:g}m'

    @classmethod
    def of(cls, text: str) -> 'Load':
        """From such as 4kg@0.3m; InputError for anything else."""
        found = _LOAD.fullmatch(text.strip())
        try:
            load = cls(float(found['mass']), float(found['length'])) if found else None
        except ValueError:
            load = None
        if load is None or not (0.0 < load.mass <= 100.0 and 0.0 < load.length <= 3.0):
            raise InputError(f'--load is {text!r}; give such as 4kg@0.3m, up to 100 kg and 3 m')
        return load


def add_motion(parser: argparse.ArgumentParser, *, start: bool) -> None:
    """Add what says which drive goes through which motion with which load."""
    add = parser.add_argument
    add('motion', metavar='MOTION', help=f'{", ".join(MOTIONS)}, or a motion/1 file')
    add(
        '--drive',
        action='append',
        metavar='NAME',
        help='drive to move (LF_KFE; KFE if there is but one), may be repeated; default: the '
        'first that the motion names. All others hold where they are',
    )
    add('--mode', choices=('position', 'velocity', 'torque'), help='one that the motion has')
    add('--amplitude', type=float, metavar='X', help='in the unit of the mode')
    add('--frequency', type=float, metavar='HZ')
    add('--duration', type=float, metavar='S', help='of each segment with an amplitude')
    if start:
        add('--start', action='store_true', help='start as soon as joint_states are sound')
    add('--load', metavar='KG@M', help='weight on an arm, such as 4kg@0.3m')
    add('--pendulum', type=float, default=0.0, metavar='NM', help='its pull at a right angle')
    add('--hanging', type=float, default=0.0, metavar='RAD', help='where it hangs; default 0')
    add('--locked', action='store_true', help='the joint is held fast')
    add('--limits', type=Path, metavar='FILE', help='joint_limits/1; default: those of ANYmal C')
    add('--fit', action='store_true', help='shorten and lower what would leave the limits')
    add(
        '--damp-others',
        action='store_true',
        help='in velocity and torque mode other joints may be damped instead of held',
    )


def load_of(options: argparse.Namespace) -> Load | None:
    """The load that the options give; InputError for one that is given twice."""
    if options.load is None:
        return None
    if options.pendulum:
        raise InputError('--load and --pendulum say the same; give one of the two')
    return Load.of(options.load)


def mounting_of(options: argparse.Namespace) -> Mounting:
    """What the drive turns."""
    load = load_of(options)
    pull = options.pendulum if load is None else load.pull
    return Mounting(pull, options.hanging, options.locked)


def motion_of(options: argparse.Namespace) -> MotionFile:
    """The motion that the options ask for, in N·m."""
    for name in ('amplitude', 'frequency', 'duration'):
        value = getattr(options, name)
        if value is not None and not (math.isfinite(value) and value > 0.0):
            raise InputError(f'--{name} is {value!r}; it must be above 0')
    motion = find_motion(options.motion, options.mode)
    changed = motion.changed(options.amplitude, options.frequency, options.duration)
    return changed.with_pull(mounting_of(options).pendulum)


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """Read the arguments, ROS ones removed; SystemExit 2 for unknown ones."""
    parser = argparse.ArgumentParser(
        prog='ros2 run policy_runner excite',
        description='Put drives through the segments of a motion file, safely.',
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_motion(parser, start=True)
    return parser.parse_args(list(arguments))
