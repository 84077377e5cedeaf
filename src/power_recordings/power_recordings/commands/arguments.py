"""Arguments of the commands."""

from argparse import ArgumentParser, Namespace
from pathlib import Path

from wattwalk_core.command import Arguments, entry_point, own_arguments


def add_doubts(made: ArgumentParser) -> None:
    """Add --slow-meter and --ignore-unit-conflicts, which admit recordings otherwise refused."""
    made.add_argument(
        '--slow-meter',
        '--slow',
        dest='slow',
        action='store_true',
        help='take power that changes less than 25 times a second: judge energy over windows',
    )
    made.add_argument(
        '--ignore-unit-conflicts',
        '--anyway',
        dest='anyway',
        action='store_true',
        help='take signals whose units or signs contradict each other',
    )


@entry_point(
    'power_recordings.commands.import_logs:run',
    'Turn logs (csv, xlsx, parquet, feather, mat, HDF5, JSON, hebilog, ROS 1 and '
    '2 bags) into one recording.',
    'example:\n'
    '  ros2 run power_recordings import hops.mat --list > hops.yaml   # look, edit the map\n'
    '  ros2 run power_recordings import hops.mat --map hops.yaml -o bags/hops\n'
    '  ros2 run power_recordings info bags/hops',
    name='import',
)
def import_logs(parser: ArgumentParser, args: Arguments) -> Namespace:
    add = parser.add_argument
    add('logs', nargs='+', type=Path, metavar='LOG', help='log file or bag folder')
    add('--map', metavar='NAME|FILE', help='ready map by name, or a YAML file (format: import/1)')
    add('--list', action='store_true', help='print columns or topics and a guessed map to edit')
    add('--msgs', type=Path, metavar='DIR', help='.msg files of types that a bag does not define')
    add('-o', '--output', type=Path, metavar='BAG', help='folder of the recording')
    add('--overwrite', action='store_true', help='replace a recording that is there')
    return parser.parse_args(own_arguments(args))


@entry_point(
    'power_recordings.commands.example:run',
    'Write a recording to try the other commands with: 25 s of a simulated walk.',
    'example:\n  ros2 run power_recordings example -o walk_small',
)
def example(parser: ArgumentParser, args: Arguments) -> Namespace:
    add = parser.add_argument
    add('-o', '--output', type=Path, metavar='BAG', required=True, help='its folder')
    return parser.parse_args(own_arguments(args))


@entry_point(
    'power_recordings.commands.index:run',
    'List the recordings that the index knows. `info` and `power_fleet track` keep in it what '
    'they worked out, so that a second run takes no time; --add reads the cards alone. It is '
    'a cache that may be deleted: a file that WATTWALK_INDEX names, else '
    '~/.cache/wattwalk/recordings.sqlite3.',
    'example:\n'
    '  ros2 run power_recordings index --add bags --robot anymal_c --since 2026-03\n'
    '  ros2 run power_recordings index --export tables',
)
def index(parser: ArgumentParser, args: Arguments) -> Namespace:
    add = parser.add_argument
    add('--add', nargs='+', type=Path, default=[], metavar='FOLDER', help='read cards in folders')
    add('--robot', default='', help='only of this robot')
    add('--unit', default='', help='only of this unit of a robot')
    add('--since', default='', metavar='DATE', help='only created on or after it: 2026-03-14')
    add('--until', default='', metavar='DATE', help='only created before it')
    add('--all', action='store_true', help='print all rows, not the first alone')
    add('--forget-lost', action='store_true', help='forget recordings whose files are gone')
    add(
        '--export',
        type=Path,
        metavar='FOLDER',
        help='write recordings, quality and coefficients as Parquet, for pandas and DuckDB',
    )
    return parser.parse_args(own_arguments(args))


@entry_point(
    'power_recordings.commands.info:run',
    'Rates, gaps, updates of the electrical signals, units judged by physics, and '
    'coverage of recordings.',
    'example:\n  ros2 run power_recordings info bags/walk_small --json info.json',
)
def info(parser: ArgumentParser, args: Arguments) -> Namespace:
    parser.add_argument('bags', nargs='+', type=Path, metavar='BAG')
    parser.add_argument('--json', type=Path, metavar='F', help='also write the figures as JSON')
    return parser.parse_args(own_arguments(args))
