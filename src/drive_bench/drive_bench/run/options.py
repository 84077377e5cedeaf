"""Options of `ros2 run drive_bench run`."""

import argparse
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from wattwalk_core.errors import InputError

from drive_bench.motion.file import MOTIONS, Load, MotionFile, find_motion, listing
from drive_bench.motion.segment_path import Mounting

PATIENCE: Final = 30.0  # s
EPILOG: Final = """\
Without --record the motion starts with --start, or on the service start, and the services stop and
estop end it. With --record the command waits for drive_supply and joint_states, starts the
recorder, then the motion, ends the bag, writes its card and checks it; there is no service start,
so that nothing moves unrecorded. Whatever ends a motion early (a fault, estop, Ctrl-C, a recorder
that ended, a full disk) damps the drives; the bag is kept, with complete: false and the reason in
its card. Parameters: rate, stale_after.

Loads act by gravity: give the torque with which the pendulum (or the hung leg) pulls at a right
angle; a held torque is then the angle at which it pulls as much. --locked: the joint is held fast,
and the drive pushes against it.

exit codes: 0 done, 1 ended by a fault, or the bag is not fit for use, 2 bad input, 130 stopped

examples:
  ros2 run drive_bench run sine --drive KFE --record
  ros2 run drive_bench run holds --drive LF_KFE --load 4kg@0.3m --record bags/bench/holds
  ros2 run drive_bench run ladder --mode velocity --drive KFE --limits limits.yaml --fit --record
  ros2 run drive_bench run next.yaml --drive LF_KFE --pendulum 22 --limits limits.yaml --start
"""


_DRIVE_HELP: Final = (
    'drive to move (LF_KFE; KFE if it is the only one), may be repeated; default: the first that '
    'the motion names. All others hold their positions'
)


@dataclass(frozen=True)
class RunOptions:
    """Options of `drive_bench run`; SI units.

    record: the bag, '' for one with a new name, None for no recording. patience: s to wait for
    topics before the recording, PATIENCE if None.
    """

    motion: str
    drive: tuple[str, ...] = ()
    mode: str | None = None
    amplitude: float | None = None
    frequency: float | None = None
    duration: float | None = None
    start: bool = False
    load: Load | None = None
    pendulum: float = 0.0
    hanging: float = 0.0
    locked: bool = False
    limits: Path | None = None
    fit: bool = False
    damp_others: bool = False
    record: str | None = None
    card: tuple[str, ...] = ()
    patience: float | None = None
    json: Path | None = None

    def __post_init__(self) -> None:
        for name in ('amplitude', 'frequency', 'duration'):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0.0):
                raise InputError(f'--{name} is {value!r}; it must be above 0')
        if self.load is not None and self.pendulum:
            raise InputError('--load and --pendulum say the same; give one of the two')
        if self.patience is not None and not 0.0 < self.patience <= 3600.0:
            raise InputError(f'--patience is {self.patience:g}; it must be above 0, up to 3600 s')
        for text in self.card:
            if '=' not in text:
                raise InputError(f'--card {text!r}: expected key=value')
        for name in ('card', 'patience', 'json'):
            if self.record is None and getattr(self, name) not in ((), None):
                raise InputError(f'--{name} goes with --record only')
        if self.start and self.record is not None:
            raise InputError('--start goes without --record, which starts the motion by itself')
        self.mounting  # noqa: B018  # checks its values

    @property
    def mounting(self) -> Mounting:
        """Load that the drive turns."""
        pull = self.pendulum if self.load is None else self.load.pull
        return Mounting(pull, self.hanging, self.locked)

    @property
    def load_text(self) -> str:
        """Load as text, such as `locked` or `2 N·m`."""
        if self.load is not None:
            return str(self.load)
        if self.locked:
            return 'locked'
        return f'{self.pendulum:g} N·m' if self.pendulum else 'none'

    def read_motion(self) -> MotionFile:
        """Return the motion with these options, its torques in N·m."""
        motion = find_motion(self.motion, self.mode)
        changed = motion.changed(self.amplitude, self.frequency, self.duration)
        return changed.with_pull(self.mounting.pendulum)

    def bag(self, motion: MotionFile, drives: Sequence[str]) -> Path:
        """Return the bag to record to; InputError for one that exists."""
        if self.record:
            check_new(Path(self.record))
            return Path(self.record)
        load = '' if self.load_text == 'none' else self.load_text.replace(' ', '').replace('·', '')
        words = [motion.name, motion.mode, '_'.join(drives), load]
        return free_name(Path('bags/bench'), '_'.join(word for word in words if word))

    def card_entries(self, motion: MotionFile, drives: Sequence[str]) -> dict[str, str]:
        """Return the entries of the recording's card, marked as not complete."""
        mode = motion.mode or 'position'
        content: Mapping[str, str] = {
            'robot': 'bench',
            'controller': f'bench {motion.name}, {mode} mode',
            'notes': f'{motion.seconds:.0f} s, load {self.load_text}',
            'motion': motion.name,
            'mode': mode,
            'load': self.load_text,
            'drives': ','.join(drives),
        }
        return {**content, **dict(text.split('=', 1) for text in self.card), 'complete': 'false'}


class _List(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        print(listing())
        parser.exit()


def parse(parser: argparse.ArgumentParser, arguments: Sequence[str]) -> RunOptions:
    """Parse arguments without those for ROS; SystemExit 2 for wrong ones."""
    add = parser.add_argument
    add('motion', metavar='MOTION', help=f'{", ".join(MOTIONS)}, or a motion/1 file')
    add('--list', nargs=0, action=_List, help='list the motions with their modes and end')
    add('--drive', action='append', metavar='NAME', help=_DRIVE_HELP)
    add('--mode', choices=('position', 'velocity', 'torque'), help='one that the motion has')
    add('--amplitude', type=float, metavar='X', help='in the unit of the mode')
    add('--frequency', type=float, metavar='HZ')
    add('--duration', type=float, metavar='S', help='of each segment with an amplitude')
    add('--start', action='store_true', help='start as soon as joint_states are sound')
    add('--load', metavar='KG@M', help='weight on an arm, such as 4kg@0.3m')
    add('--pendulum', type=float, default=0.0, metavar='NM', help='its pull at a right angle')
    add('--hanging', type=float, default=0.0, metavar='RAD', help='where it hangs; default 0')
    add('--locked', action='store_true', help='the joint is held fast')
    add('--limits', type=Path, metavar='FILE', help='joint_limits/1; default: those of ANYmal C')
    add('--fit', action='store_true', help='shorten and lower what would leave the limits')
    add('--damp-others', action='store_true', help='damp other joints where they cannot be held')
    add('--record', nargs='?', const='', metavar='BAG', help='default: a new bag in bags/bench')
    recording = parser.add_argument_group('with --record').add_argument
    recording('--card', nargs='+', action='extend', metavar='KEY=VALUE', help='robot, …')
    recording('--patience', type=float, metavar='S', help='for the topics; default 30')
    recording('--json', type=Path, metavar='FILE', help='write the check, too')
    given: dict[str, Any] = vars(parser.parse_args(list(arguments)))
    given |= {name: tuple(given[name] or ()) for name in ('drive', 'card')}
    given.pop('list', None)
    given['load'] = None if given['load'] is None else Load.of(given['load'])
    return RunOptions(**given)


def free_name(folder: Path, name: str) -> Path:
    """Return a path in a folder that does not exist: name, name_2 and so on."""
    count = 1
    while (path := folder / (name if count == 1 else f'{name}_{count}')).exists():
        count += 1
    return path


def check_new(bag: Path) -> None:
    """Raise InputError for a bag that exists."""
    if bag.exists():
        raise InputError(f'{bag} exists already: choose another name or remove it')


def resolve(
    wanted: Sequence[str], joints: Sequence[str], there: Sequence[bool]
) -> tuple[str, ...]:
    """Return joints by full name or ending: KFE is LF_KFE if no other joint _KFE is present.

    there: whether each joint is present. InputError if none or several match.
    """
    return tuple(dict.fromkeys(_one(name, joints, there) for name in wanted))


def _one(name: str, joints: Sequence[str], there: Sequence[bool]) -> str:
    if name in joints:
        return name
    fits = [joint for joint in joints if joint.endswith(f'_{name}')]
    present = [joint for joint in fits if there[list(joints).index(joint)]]
    if len(present) == 1:
        return present[0]
    if len(fits) == 1:
        return fits[0]
    if fits:
        raise InputError(f'--drive {name} may be {", ".join(present or fits)}; give one of them')
    raise InputError(f'no drive {name!r} in joint_states; it has {", ".join(joints)}')
