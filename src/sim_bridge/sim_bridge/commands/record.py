"""`ros2 run sim_bridge record`: make recordings to train and evaluate power models on."""

import argparse
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

from policy_runner.policies.by_name import by_short_name
from power_recordings.card import FILE, Card
from wattwalk_core.anymal import JOINT_NAMES, JOINT_TYPES
from wattwalk_core.engine.task_engine import TaskEngine
from wattwalk_core.errors import InputError

from sim_bridge.commands.arguments import SECONDS, SEED
from sim_bridge.offline.history import record_history
from sim_bridge.offline.run import run_offline
from sim_bridge.plant.ageing import AgeingPlan
from sim_bridge.plant.parameters import Plant

_SHORTEST, _LONGEST = 1.0, 36_000.0  # s
_APART = 100  # seeds between controllers, more than a set has recordings


@dataclass(frozen=True)
class RecordingPlan:
    """One recording of a set; drives: those metered; fastest: as of `plans`."""

    name: str
    seed: int
    drives: tuple[str, ...]
    controller: str = 'trot'
    unit: int | None = None
    terrain: str = 'flat'
    pushes: bool = False
    fastest: tuple[float, float, float] | None = None


def plans(
    which: str,
    seed: int = SEED,
    controllers: Sequence[str] = ('trot',),
    fastest: tuple[float, float, float] | None = None,
) -> tuple[RecordingPlan, ...]:
    """Return the recordings of the set `paper` or `robustness`, with seeds that count up.

    controllers: policies by name or folder; with several, the set `paper` is recorded once with
    each. fastest: limits of its random velocity commands: m/s forwards, m/s sideways, rad/s; those
    of `CommandRange` if None. InputError for another set.
    """
    if which == 'robustness':
        return (
            RecordingPlan('trot_slow', seed + 10, JOINT_NAMES, 'trot_slow'),
            RecordingPlan('trot_high', seed + 11, JOINT_NAMES, 'trot_high'),
            RecordingPlan('unit', seed + 12, JOINT_NAMES, unit=2),
        )
    if which != 'paper':
        raise InputError(f'set {which!r} is not one of {", ".join(SECONDS)}')
    return tuple(
        RecordingPlan(
            kind if len(controllers) == 1 else f'{kind}_{name}',
            seed + i + _APART * number,
            (f'LF_{kind}',),
            controller,
            terrain='rough',
            pushes=True,
            fastest=fastest,
        )
        for number, (name, controller) in enumerate(by_short_name(controllers).items())
        for i, kind in enumerate(JOINT_TYPES)
    )


def record(
    plan: RecordingPlan, folder: Path, seconds: float, plant: str, *, loaded: Plant, progress: bool
) -> bool:
    """Make one recording in a folder; return False if it is there already, complete.

    plant: file or name; loaded: the same plant in memory, where the file may be absent. InputError
    if a recording of other settings is there, or for a duration outside 1..36000 s.
    """
    if not _SHORTEST <= seconds <= _LONGEST:
        raise InputError(f'--seconds is {seconds:g}; it must lie in {_SHORTEST:g}..{_LONGEST:g}')
    bag = folder / plan.name
    content = {**asdict(plan), 'drives': list(plan.drives)}
    fastest = content.pop('fastest')
    if fastest is not None:  # older recordings do not have it
        content['fastest'] = list(fastest)
    wanted = {'plan': content, 'seconds': seconds, 'plant': plant}
    found = Card.load(bag).other if (bag / FILE).exists() else {}
    if 'plan' in found:
        for key, value in wanted.items():
            if found.get(key) != value:
                raise InputError(
                    f'{bag} was recorded with {key} = {found.get(key)}, not {value}; '
                    'give another folder'
                )
        return False
    folder.mkdir(parents=True, exist_ok=True)
    run_offline(
        bag,
        duration=seconds,
        seed=plan.seed,
        plant=loaded if plan.unit is None else loaded.unit(plan.unit),
        controller=plan.controller,
        terrain=plan.terrain,
        pushes=plan.pushes,
        drives=plan.drives,
        fastest=plan.fastest,
        overwrite=True,
        progress=progress,
    )
    card = Card.load(bag)
    replace(card, other={**card.other, **wanted}).save(bag)
    return True


def _age(options: argparse.Namespace) -> None:
    if options.seconds is not None or options.seed != SEED:
        raise InputError('--seconds and --seed are entries of the plan in the set ageing')
    plan = AgeingPlan.load(options.plan)
    with TaskEngine(options.place) as engine:
        for number, bag in enumerate(record_history(plan, options.output, engine), 1):
            print(f'{number} of {len(plan.days)}: {bag} recorded', flush=True)
    print(f'next: ros2 run power_fleet track {options.output}/* --model model.yaml')


def run(options: argparse.Namespace) -> None:
    """Make those recordings of a set that do not exist yet."""
    if options.plan is not None:
        _age(options)
        return
    place = options.place
    seconds = SECONDS[options.set] if options.seconds is None else options.seconds
    wanted = plans(options.set, options.seed, options.controllers, options.fastest)
    made_of = partial(
        record,
        folder=options.output.absolute(),
        seconds=seconds,
        plant=options.plant,
        loaded=Plant.load(options.plant),
        progress=not place.scheduler and place.processes(len(wanted)) == 1,
    )
    with TaskEngine(place) as engine:
        results = engine.in_order(made_of, wanted)
        for number, (plan, made) in enumerate(zip(wanted, results, strict=True), 1):
            state = 'recorded' if made else 'there already'
            print(f'{number} of {len(wanted)}: {options.output / plan.name} {state}', flush=True)
    bags = ' '.join(str(options.output / plan.name) for plan in wanted)
    print(
        f'next: ros2 run power_estimator train {bags} -o runs/paper'
        if options.set == 'paper'
        else f'next: ros2 run power_estimator benchmark {bags} --models ppn:runs/paper'
    )
