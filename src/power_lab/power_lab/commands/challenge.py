"""`ros2 run power_lab challenge` and `reveal`: learn the lab on a hidden effect."""

import argparse
import json

from sim_bridge.plant.parameters import Plant
from wattwalk_core.console import write_json
from wattwalk_core.errors import InputError

from power_lab.challenge.challenge import draw, score, seal, unseal
from power_lab.structure.words import in_words

DRIVES = ('LF_HAA', 'LF_HFE', 'LF_KFE')


def run(options: argparse.Namespace) -> None:
    from sim_bridge.offline.run import run_offline  # a bus, which analyses do without

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
    seal(challenge.content(), options.output)
    bag, known = options.output, ','.join(challenge.known)
    write_json(options.json, {'known': list(challenge.known)})
    if options.walk:
        print(f'{bag}: the same robot walks again; judge models on it that never saw it:')
        print(f'  ros2 run power_lab compare {bag} --models base.yaml better.yaml')
        return
    print(f'{bag}: something may be hidden in its drives. What the model may know:')
    print(f'  ros2 run power_lab fit {bag} --effects {known} -o base.yaml')
    print('Then find what it misses, and see whether you are right:')
    print(f'  ros2 run power_lab diagnose {bag} --model base.yaml --json why.json')
    print(f'  ros2 run power_lab reveal {bag} --diagnosis why.json')


def reveal(options: argparse.Namespace) -> None:
    answer = unseal(options.bag)
    if answer.get('fleet'):
        raise InputError(
            f'{options.bag} is a fleet of recordings: ros2 run power_fleet reveal {options.bag}'
        )
    hidden = ', '.join(in_words(name) for name in answer['hidden']) or 'nothing'
    times = f' at {answer["strength"]:g} times its usual strength' if answer['hidden'] else ''
    if options.diagnosis:
        try:
            found = json.loads(options.diagnosis.read_text(encoding='utf-8'))
            verdict = found['verdict']
        except (OSError, ValueError, LookupError, TypeError) as error:
            raise InputError(f'{options.diagnosis}: not what diagnose --json writes') from error
        answer['score'] = score(answer, found)
    write_json(options.json, answer)
    print(f'hidden: {hidden}{times}; the verdict to expect is {answer["expected"]}')
    if options.diagnosis:
        print(f'the diagnosis ({verdict}) is {answer["score"]}')
