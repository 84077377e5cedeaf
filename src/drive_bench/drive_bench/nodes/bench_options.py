"""The command line of `ros2 run policy_runner bench`."""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

from wattwalk_core.errors import InputError

from drive_bench.motion.file import MotionFile
from drive_bench.motion.library import listing
from drive_bench.nodes.excite_options import add_motion, load_of
from drive_bench.run.recorder_process import free_name

_EPILOG = f"""\
motions, with their modes, the first being the default:
{listing()}

It waits until drive_supply and joint_states come, starts the recorder, puts the drive through the
motion with all the care of excite, ends the bag, writes its card and checks what came of it.
Whatever ends the motion early (a fault, estop, Ctrl-C, a recorder that is gone, a full disk) damps
the drives; the bag is kept and its card says complete: false and why.

exit codes: 0 done, 1 ended by a fault or the bag is not fit for use, 2 bad input, 130 stopped

examples:
  ros2 run policy_runner bench sine --drive KFE
  ros2 run policy_runner bench holds --drive LF_KFE --load 4kg@0.3m -o bags/bench/holds
  ros2 run policy_runner bench ladder --mode velocity --drive KFE --limits limits.yaml --fit
  ros2 run policy_runner bench next.yaml --load 5kg@0.45m -o bags/next
"""


class _List(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        print(listing())
        parser.exit()


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """Read the arguments, ROS ones removed; SystemExit 2 for unknown ones."""
    parser = argparse.ArgumentParser(
        prog='ros2 run policy_runner bench',
        description='Put a drive through a motion, record it, file it and check it.',
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_motion(parser, start=False)
    add = parser.add_argument
    add('-o', '--output', type=Path, metavar='BAG', help='default: a new one in bags/bench')
    add('--list', nargs=0, action=_List, help='list the motions and end')
    add('--card', nargs='+', action='extend', default=[], metavar='KEY=VALUE', help='robot, …')
    add('--patience', type=float, default=30.0, metavar='S', help='to wait for what is needed')
    add('--json', type=Path, metavar='FILE', help='the check, too')
    options = parser.parse_args(list(arguments))
    if not 0.0 < options.patience <= 3600.0:
        raise InputError(f'--patience is {options.patience:g}; it must be above 0, up to 3600 s')
    for text in options.card:
        if '=' not in text:
            raise InputError(f'--card {text!r}: expected key=value')
    return options


def load_text(options: argparse.Namespace) -> str:
    """What the drive turns, in a word or two."""
    load = load_of(options)
    if load is not None:
        return str(load)
    if options.locked:
        return 'locked'
    return f'{options.pendulum:g} N·m' if options.pendulum else 'none'


def bag_of(options: argparse.Namespace, motion: MotionFile, drives: Sequence[str]) -> Path:
    """Where to record to."""
    if options.output is not None:
        return Path(options.output)
    load = load_text(options).replace(' ', '').replace('·', '')
    words = [motion.name, motion.mode, '_'.join(drives), '' if load == 'none' else load]
    return free_name(Path('bags/bench'), '_'.join(word for word in words if word))


def card_of(
    options: argparse.Namespace, motion: MotionFile, drives: Sequence[str]
) -> dict[str, str]:
    """The card by keys, as it is before the motion is done."""
    mode = motion.mode or 'position'
    content: Mapping[str, str] = {
        'robot': 'bench',
        'controller': f'bench {motion.name}, {mode} mode',
        'notes': f'{motion.seconds:.0f} s, load {load_text(options)}',
        'motion': motion.name,
        'mode': mode,
        'load': load_text(options),
        'drives': ','.join(drives),
    }
    given = dict(text.split('=', 1) for text in options.card)
    return {**content, **given, 'complete': 'false'}
