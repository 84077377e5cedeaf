"""`ros2 run power_fleet challenge` and `reveal`: learn `track` on a hidden change."""

import argparse

from power_lab.challenge.challenge import unseal
from power_lab.commands.challenge import DRIVES
from wattwalk_core.console import write_json
from wattwalk_core.engine.options import Workplace
from wattwalk_core.engine.task_engine import TaskEngine
from wattwalk_core.errors import InputError

from power_fleet.fleet_challenge import draw_fleet, record_fleet


def run(options: argparse.Namespace) -> None:
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


def reveal(options: argparse.Namespace) -> None:
    answer = unseal(options.folder)
    if not answer.get('fleet'):
        raise InputError(
            f'{options.folder} is a single recording: ros2 run power_lab reveal {options.folder}'
        )
    write_json(options.json, answer)
    for own in answer['hidden']:
        print(
            f'hidden: unit {own["unit"]}, {own["drive"]}: {own["words"]}, '
            f'from its recording {own["recording"]} on (the first is 0)'
        )
    if not answer['hidden']:
        print('hidden: nothing; only weather, gaits and payloads differ')
