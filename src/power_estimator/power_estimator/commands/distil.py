"""`ros2 run power_estimator distil`: a small network from a trained one, for use in rewards."""

import argparse
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path

from power_recordings.reading.bag_folder import check_recordings
from rich.console import Console
from wattwalk_core.console import output, print_table
from wattwalk_core.engine.options import Workplace
from wattwalk_core.errors import InputError

from power_estimator.drive_types import assign
from power_estimator.evaluation.benchmark import table
from power_estimator.evaluation.cost import policy_step_cost
from power_estimator.judge.judge import Judge
from power_estimator.judge.recordings import load
from power_estimator.judge.result import JudgedModel
from power_estimator.network.checkpoint import Checkpoint
from power_estimator.network.ppn import PowerPredictionNetwork
from power_estimator.recordings import TrainingSet, describe, training_set
from power_estimator.scores import r2
from power_estimator.training.cross_validation import CrossValidation
from power_estimator.training.progress_bars import training_bars
from power_estimator.training.protocol import Protocol
from power_estimator.training.run_folder import TABLE, NetworkRunFolder
from power_estimator.training.trainer_config import TrainerConfig

TEACHER, STUDENT = 'teacher', 'student'


def run(options: argparse.Namespace) -> None:
    place = Workplace.of(options)
    check_recordings(options.bags)
    progress = Console(stderr=True)
    teacher = PowerPredictionNetwork(Checkpoint.load(options.teacher), TEACHER)
    training = TrainerConfig(epochs=options.epochs, seed=options.seed)
    with progress.status('reading and aligning'):
        given = training_set(in_order_of(teacher, options.bags), options.drives)
        validation = validation_of(teacher, given, hidden=options.hidden, training=training)
    folder = NetworkRunFolder(options.output)
    about = {
        'teacher': str(options.teacher),
        'types': {t.name: list(t.patterns) for t in validation.types},
        'network': asdict(validation.config),
        'training': asdict(training),
    }
    folder.open(about, validation.recordings, resume=options.resume)
    jobs = [job.name for job in validation.jobs]
    with training_bars(progress, jobs, training.epochs, folder.path) as show:
        trainers = validation.run(folder, show, place.processes(len(jobs)))
    with progress.status('testing on held-out data'):
        checkpoint = validation.checkpoint(0, trainers)
        about = {**checkpoint.training, 'teacher': str(options.teacher)}
        student = PowerPredictionNetwork(replace(checkpoint, training=about), STUDENT)
        folder.save_model(0, student.checkpoint)
        recordings = load(given.paths, options.drives, anyway=True)
        live = given.as_live().drives(recordings.data.names)
        smoothed, as_live = (
            Judge(own).compare([teacher, student], types=student.types)
            for own in (recordings, replace(recordings, smoothed=live))
        )
        columns = assign(recordings.data.names, student.types)
        imitation = {
            kind: r2(*(judged.estimated[:, columns[kind]] for judged in smoothed))
            for kind in smoothed[0].types
        }
        drives = [n for n in given.data.names if any(t.matches(n) for t in validation.types)]
        cost = {
            model.name: {str(n): policy_step_cost(model, drives, n) for n in options.robots}
            for model in (teacher, student)
        }
        result = {
            **table([smoothed]),
            'live': table([as_live])['models'],
            'student_against_teacher': imitation,
            'us_per_robot_and_policy_step': cost,
        }
        folder.save_json(TABLE, result)
        folder.finish(trainers)
    sizes = {TEACHER: teacher.checkpoint.config.hidden, STUDENT: options.hidden}
    title = f'R² on held-out data; µs per robot of {len(drives)} drives and policy step'
    _print((smoothed, as_live), cost, sizes, title)
    told = ', '.join(f'{kind} {value:.3f}' for kind, value in imitation.items())
    print(f'student against teacher, R²: {told}')
    print(f'in a reward: BatchPower.load({f"ppn:{options.output}"!r}, drives, robots)')
    print(
        f'ros2 run power_estimator benchmark {shlex.quote(str(options.bags[0]))} --models '
        f'{shlex.quote(f"ppn:{options.teacher}")} {shlex.quote(f"ppn:{options.output}")}'
    )


def in_order_of(teacher: PowerPredictionNetwork, bags: Sequence[Path]) -> list[Path]:
    """Sort recordings in the order of the teacher's training; new ones come last."""
    order = {r.sha256: i for i, r in enumerate(teacher.checkpoint.recordings)}
    return sorted(bags, key=lambda bag: order.get(describe(bag).sha256, len(order)))


def validation_of(
    teacher: PowerPredictionNetwork, given: TrainingSet, *, hidden: int, training: TrainerConfig
) -> CrossValidation:
    """Return the training of a student on the teacher's outputs for the recordings' signals.

    The recordings are split as for the teacher, so that its test part is new to the student too.
    hidden: units of the student. InputError for recordings that are too short or drives unknown
    to the teacher.
    """
    config, about = teacher.checkpoint.config, teacher.checkpoint.training
    if hidden >= config.hidden:
        raise InputError(f'hidden = {hidden} is not below the {config.hidden} of the teacher')
    if about.get('fold', 0) != 0:
        raise InputError('the teacher is not of fold 0; give the run folder it belongs to')
    return CrossValidation.of(
        given,
        teacher.types,
        network=replace(config, hidden=hidden),
        training=training,
        protocol=Protocol(about.get('segments', 6), 1, config.history),
        targets=teacher.predict(given.data),
    )


def _print(
    judged: Sequence[Sequence[JudgedModel]],
    cost: Mapping[str, Mapping[str, float]],
    sizes: Mapping[str, int],
    title: str,
) -> None:
    parts = [{one.name: one for one in part} for part in judged]
    kinds = list(judged[0][0].types)
    robots = list(next(iter(cost.values())))
    columns = (
        *('network', 'units'),
        *(f'{kind} {form}' for form in ('R²', 'live') for kind in kinds),
        *(f'{n} robots' for n in robots),
    )
    rows = [
        [
            *(name, str(units)),
            *(f'{part[name].types[kind].r2:.3f}' for part in parts for kind in kinds),
            *(f'{cost[name][n]:.1f}' for n in robots),
        ]
        for name, units in sizes.items()
    ]
    print_table(output(140), columns, rows, title)
