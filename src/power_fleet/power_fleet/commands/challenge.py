"""`ros2 run power_fleet challenge` and `reveal`: learn `track` on a hidden change."""

from collections.abc import Sequence
from pathlib import Path

from power_lab.commands import options as common
from power_lab.commands.challenge import DRIVES
from wattwalk_core.command import command
from wattwalk_core.console import write_json
from wattwalk_core.engine.options import Workplace, add_workplace
from wattwalk_core.errors import InputError


@command
def main(args: Sequence[str] | None = None) -> int:
    """Entry point of challenge."""
    parser = common.parser(
        'challenge',
        'Record two simulated robots over months, in one of which a drive or its meter may '
        'change. The answer is sealed in the folder.',
        'example: ros2 run power_fleet challenge --seed 7 -o bags/fleet',
        effects=False,
        package='power_fleet',
    )
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

    from wattwalk_core.engine.task_engine import TaskEngine

    from power_fleet.fleet_challenge import draw_fleet, record_fleet

    challenge = draw_fleet(options.seed, options.recordings, options.duration, DRIVES)
    with TaskEngine(Workplace.of(options)) as engine:
        for number, bag in enumerate(record_fleet(challenge, options.output, engine), 1):
            print(f'{number} of {options.recordings}: {bag}', flush=True)
    bags = options.output
    print(f'{bags}: two robots over months. Something may have changed in a drive of one of them.')
    known = 'shaft,copper_loss,idle,coulomb_friction,viscous_friction,rotor_inertia'
    first = bags / f'robot_0_000_{challenge.plans[0].days[0].day:g}'
    print(f'  ros2 run power_lab fit {first} --effects {known} -o base.yaml')
    print(f'  ros2 run power_fleet track {bags}/robot_* --model base.yaml')
    print(f'  ros2 run power_fleet reveal {bags}')
    return 0


@command
def reveal(args: Sequence[str] | None = None) -> int:
    """Entry point of reveal."""
    parser = common.parser(
        'reveal',
        'Open the sealed answer of a fleet.',
        'example: ros2 run power_fleet reveal bags/fleet',
        effects=False,
        package='power_fleet',
    )
    parser.add_argument('folder', type=Path, metavar='FOLDER', help='written by challenge')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the answer as JSON')
    options = parser.parse_args(args)

    from power_lab.challenge.challenge import unseal

    answer = unseal(options.folder)
    if not answer.get('fleet'):
        raise InputError(
            f'{options.folder} is a single recording: ros2 run power_lab reveal {options.folder}'
        )
    for own in answer['hidden']:
        print(
            f'hidden: unit {own["unit"]}, {own["drive"]}: {own["words"]}, '
            f'from its recording {own["recording"]} on (the first is 0)'
        )
    if not answer['hidden']:
        print('hidden: nothing; only weather, gaits and payloads differ')
    if options.json:
        write_json(options.json, answer)
    return 0
