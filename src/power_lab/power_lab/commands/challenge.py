"""`ros2 run power_lab challenge` and `reveal`: learn the lab on a hidden effect."""

import json
from collections.abc import Sequence
from pathlib import Path

from wattwalk_core.command import command
from wattwalk_core.console import write_json
from wattwalk_core.errors import InputError

from power_lab.commands import options as common

DRIVES = ('LF_HAA', 'LF_HFE', 'LF_KFE')


@command
def main(args: Sequence[str] | None = None) -> int:
    """Entry point of challenge."""
    parser = common.parser(
        'challenge',
        'Record a walk of a simulated robot with an effect hidden in its drives (or none, or one '
        'that no catalogue knows). The answer is sealed in the bag.',
        'example: ros2 run power_lab challenge --seed 7 -o bags/riddle',
        effects=False,
    )
    add = parser.add_argument
    add('--seed', type=int, required=True, metavar='N', help='draws what is hidden')
    add('-o', '--output', type=Path, required=True, metavar='BAG', help='folder to write')
    add('--walk', type=int, default=0, metavar='N', help='another walk of the same robot')
    add('--duration', type=float, default=150.0, metavar='S', help='to record (default: 150)')
    add('--plant', default='anymal_c', metavar='FILE', help='plant to hide it in')
    add('--json', type=Path, metavar='FILE', help='write what the model may know as JSON')
    add('--overwrite', action='store_true', help='replace a bag that is there')
    options = parser.parse_args(args)
    for name in ('seed', 'walk'):
        if getattr(options, name) < 0:
            raise InputError(f'--{name} {getattr(options, name)}: give a number from 0')
    if not 30.0 <= options.duration <= 3600.0:
        raise InputError(f'--duration {options.duration:g}: it must lie in 30..3600 s')

    from sim_bridge.offline.run import run_offline
    from sim_bridge.plant.parameters import Plant

    from power_lab.challenge.challenge import draw, seal

    challenge = draw(options.seed)
    plant = challenge.plant(Plant.load(options.plant))
    run_offline(
        options.output,
        duration=options.duration,
        seed=options.seed + 100_000 * options.walk,
        plant=plant,
        drives=DRIVES,
        overwrite=options.overwrite,
        progress=True,
    )
    seal(challenge, options.output)
    bag, known = options.output, ','.join(challenge.known)
    if options.json:
        write_json(options.json, {'known': list(challenge.known)})
    if options.walk:
        print(f'{bag}: the same robot walks again; judge models on it that never saw it:')
        print(f'  ros2 run power_lab compare {bag} --models base.yaml better.yaml')
        return 0
    print(f'{bag}: something may be hidden in its drives. What the model may know:')
    print(f'  ros2 run power_lab fit {bag} --effects {known} -o base.yaml')
    print('Then find what it misses, and see whether you are right:')
    print(f'  ros2 run power_lab diagnose {bag} --model base.yaml --json why.json')
    print(f'  ros2 run power_lab reveal {bag} --diagnosis why.json')
    return 0


@command
def reveal(args: Sequence[str] | None = None) -> int:
    """Entry point of reveal."""
    parser = common.parser(
        'reveal',
        'Open the sealed answer of a challenge.',
        'example: ros2 run power_lab reveal bags/riddle --diagnosis why.json',
        effects=False,
    )
    add = parser.add_argument
    add('bag', type=Path, metavar='BAG', help='written by challenge')
    add('--diagnosis', type=Path, metavar='FILE.json', help='what diagnose --json wrote')
    add('--json', type=Path, metavar='FILE', help='write the answer as JSON')
    options = parser.parse_args(args)

    from power_lab.challenge.challenge import score, unseal
    from power_lab.structure.words import in_words

    answer = unseal(options.bag)
    if answer.get('fleet'):
        raise InputError(
            f'{options.bag} is a fleet of recordings: ros2 run power_fleet reveal {options.bag}'
        )
    hidden = ', '.join(in_words(name) for name in answer['hidden']) or 'nothing'
    times = f' at {answer["strength"]:g} times its usual strength' if answer['hidden'] else ''
    print(f'hidden: {hidden}{times}; the verdict to expect is {answer["expected"]}')
    if options.diagnosis:
        try:
            found = json.loads(options.diagnosis.read_text(encoding='utf-8'))
        except (OSError, ValueError) as error:
            raise InputError(f'{options.diagnosis}: not what diagnose --json writes') from error
        if not isinstance(found, dict) or 'verdict' not in found:
            raise InputError(f'{options.diagnosis}: not what diagnose --json writes')
        answer['score'] = score(answer, found)
        print(f'the diagnosis ({found["verdict"]}) is {answer["score"]}')
    if options.json:
        write_json(options.json, answer)
    return 0
