"""Arguments of the commands."""

from argparse import ArgumentParser, Namespace
from pathlib import Path

from wattwalk_core.command import Arguments, entry_point, own_arguments
from wattwalk_core.console import PICTURES, ending
from wattwalk_core.errors import InputError

_CALIBRATE = """\
The analyser's CSV may have any dialect, 20 Hz to 1 MHz, and seconds, dates or an epoch on any
clock. It is aligned with the recording by correlation: the motion has to begin, end or vary
within both. Columns are identified by their heads, or by --columns.

examples:
  ros2 run power_calibration calibrate bags/fig2 --reference fig2.csv -o calibration.yaml \\
      --report fig2.html
  ros2 run power_calibration calibrate bags/hfe --reference hfe.csv -o calibration.yaml \\
      --onto calibration.yaml --columns "time=1,voltage=U1,current=I1*0.001"
  ros2 run power_daq daq --ros-args -p calibration:=calibration.yaml
"""


@entry_point(
    'power_calibration.commands.calibrate:run',
    'Compare one drive of a recording with the log of a certified power analyser. Fits '
    'gain and offset of voltage and current with intervals, states the bandwidth, and writes '
    'the file that the DAQ node applies.',
    _CALIBRATE,
)
def calibrate(parser: ArgumentParser, args: Arguments) -> Namespace:
    add = parser.add_argument
    add('recording', type=Path, metavar='BAG')
    add('--reference', type=Path, required=True, metavar='CSV', help="the analyser's log")
    add(
        '-o',
        '--output',
        type=ending('--output', '.yaml', '.yml'),
        required=True,
        metavar='YAML',
        help='file to write',
    )
    add('--drive', metavar='NAME', help='the drive in the log, if several were measured')
    add(
        '--columns',
        default='',
        metavar='MAP',
        help='time=NAME,voltage=NAME,current=NAME,power=NAME; a head or a number from 1, with '
        '*scale if needed',
    )
    add(
        '--onto',
        type=Path,
        metavar='YAML',
        help='keep its other channels; if it was applied to the recording, the two are combined',
    )
    _add_results(parser)
    options = parser.parse_args(own_arguments(args))
    if not options.reference.is_file():
        raise InputError(f'cannot read {options.reference}: there is no such file')
    return options


_SYNC = """\
examples:
  ros2 run power_calibration sync bags/walk_small
  ros2 run power_calibration sync bags/walk_1 --drives LF_KFE RF_KFE --report sync.html \\
      --json sync.json
"""


@entry_point(
    'power_calibration.commands.sync:run',
    'Measure the delay of electrical samples against joint samples, the error '
    'of power that it causes, and the regularity of the stamps of each stream.',
    _SYNC,
)
def sync(parser: ArgumentParser, args: Arguments) -> Namespace:
    add = parser.add_argument
    add('recording', type=Path, metavar='BAG')
    add('--drives', nargs='+', metavar='NAME', help='only these')
    _add_results(parser)
    return parser.parse_args(own_arguments(args))


def _add_results(parser: ArgumentParser) -> None:
    parser.add_argument('--json', type=Path, metavar='F', help='results as JSON')
    parser.add_argument(
        '--report',
        type=ending('--report', '.html', *PICTURES),
        metavar='F',
        help='page (.html) or picture (.png, .svg, .pdf)',
    )
