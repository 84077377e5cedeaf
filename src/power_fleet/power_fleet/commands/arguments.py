"""Arguments of the commands."""

from argparse import ArgumentParser, Namespace
from pathlib import Path

from power_lab.commands import arguments as common
from wattwalk_core.command import Arguments, entry_point
from wattwalk_core.engine.options import add_workplace
from wattwalk_core.errors import InputError


@entry_point(
    'power_fleet.commands.track:run',
    'Fit one model to each of many recordings and find what changes over time: an effect of '
    'a drive, or an error of its meter. At most one of twenty quiet histories raises an '
    'alarm. Recordings are taken in the order of their time.',
    'example: ros2 run power_fleet track bags/day_* --model base.yaml --json t.json '
    '--report t.html',
)
def track(parser: ArgumentParser, args: Arguments) -> Namespace:
    common.add_bags(parser)
    parser.add_argument('--model', required=True, metavar='MODEL.yaml', help='model of effects')
    add_workplace(parser, 'recordings')
    common.add_outputs(parser)
    return parser.parse_args(args)


@entry_point(
    'power_fleet.commands.challenge:run',
    'Record two simulated robots over months, in one of which a drive or its meter may '
    'change. The answer is sealed in the folder.',
    'example: ros2 run power_fleet challenge --seed 7 -o bags/fleet',
)
def challenge(parser: ArgumentParser, args: Arguments) -> Namespace:
    add = parser.add_argument
    add('--seed', type=int, required=True, metavar='N', help='draws what is hidden')
    add('-o', '--output', type=Path, required=True, metavar='FOLDER', help='folder to write')
    add('--recordings', type=int, default=40, metavar='N', help='in all (default: 40)')
    add('--duration', type=float, default=30.0, metavar='S', help='of each (default: 30)')
    add_workplace(parser, 'recordings')
    options = parser.parse_args(args)
    if options.seed < 0:
        raise InputError(f'--seed {options.seed}: give a number from 0')
    if not 10.0 <= options.duration <= 3600.0:
        raise InputError(f'--duration {options.duration:g}: it must lie in 10..3600 s')
    if options.output.exists():
        raise InputError(f'{options.output} is there already; give another folder')
    return options


@entry_point(
    'power_fleet.commands.challenge:reveal',
    'Open the sealed answer of a fleet.',
    'example: ros2 run power_fleet reveal bags/fleet',
)
def reveal(parser: ArgumentParser, args: Arguments) -> Namespace:
    parser.add_argument('folder', type=Path, metavar='FOLDER', help='written by challenge')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the answer as JSON')
    return parser.parse_args(args)
