"""Arguments of the command."""

from argparse import ArgumentParser, Namespace
from pathlib import Path

from wattwalk_core.command import Arguments, entry_point, own_arguments

from sound_levels.levels.settings import METHODS, TIMES, WEIGHTINGS

_SOUND = """\
Without --calibration levels are relative to full scale, and only differences are meaningful.

examples:
  ros2 run sound_levels sound walk.wav
  ros2 run sound_levels sound --policy baseline=b1.wav,b2.wav --policy pmp=p1.wav,p2.wav \\
      --calibration tone.wav --report sound.html
  ros2 run sound_levels sound b.wav p.wav --recording bags/b bags/p --calibration tone.wav \\
      --picture fig7.png
"""


@entry_point(
    'sound_levels.commands.sound:run',
    'Sound levels over time (IEC 61672-1) of sound files, by policy, in dB SPL '
    'with a calibrator; statistics, differences with intervals, third-octave spectra.',
    _SOUND,
)
def sound(parser: ArgumentParser, args: Arguments) -> Namespace:
    add = parser.add_argument
    add('files', nargs='*', type=Path, metavar='WAV', help='wav, flac, …; 8 to 192 kHz')
    add(
        '--policy',
        action='append',
        default=[],
        metavar='NAME=WAV,WAV',
        help='files of one policy; the others are compared with the first policy',
    )
    add(
        '--recording',
        nargs='+',
        default=[],
        type=Path,
        metavar='BAG',
        help='made at the same time: one for each file, in the order of the files',
    )
    add('--calibration', type=Path, metavar='WAV', help='of an acoustic calibrator, same gain')
    add('--level', type=float, default=94.0, metavar='DB', help='of the calibrator (94 dB SPL)')
    add('--tone', type=float, default=1000.0, metavar='HZ', help='of the calibrator (1000)')
    add('--weighting', choices=WEIGHTINGS, default='A')
    add('--time', choices=tuple(TIMES), default='fast', help='weighting: 125 ms or 1 s')
    add('--channel', type=int, metavar='N', help='from 1; default: the energy mean of all')
    add('--align', choices=METHODS, default='auto', help='alignment of sound and recording')
    add('--clap-at', type=float, metavar='S', help='of the recording, if its IMU has no jolt')
    add('--from', dest='start', type=float, metavar='S', help='start of the evaluated part')
    add('--to', dest='stop', type=float, metavar='S', help='its end')
    add('--json', type=Path, metavar='F', help='results as JSON')
    add('--report', type=Path, metavar='F.html', help='one page that needs no network')
    add('--picture', type=Path, metavar='F.png', help='level over time, as Figure 7')
    return parser.parse_args(own_arguments(args))
