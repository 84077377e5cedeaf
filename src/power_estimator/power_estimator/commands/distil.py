"""`ros2 run power_estimator distil`: a small network from a trained one, for use in rewards."""

import argparse
import shlex
from collections.abc import Mapping
from dataclasses import asdict, replace

from power_recordings.reading.bag_folder import check_recordings
from rich.console import Console
from wattwalk_core.console import output, print_table
from wattwalk_core.engine.options import Workplace

from power_estimator.evaluation.benchmark import table
from power_estimator.evaluation.cost import policy_step_cost
from power_estimator.judge.recordings import load
from power_estimator.network.checkpoint import Checkpoint
from power_estimator.network.ppn import PowerPredictionNetwork
from power_estimator.recordings import training_set
from power_estimator.training.distillation import (
    STUDENT,
    TEACHER,
    DistillationResult,
    compared,
    in_order_of,
    validation_of,
)
from power_estimator.training.progress_bars import training_bars
from power_estimator.training.run_folder import TABLE, NetworkRunFolder
from power_estimator.training.trainer_config import TrainerConfig


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
    workers = place.processes(len(jobs))
    with training_bars(progress, jobs, training.epochs, folder.path) as show:
        trainers = validation.run(folder, show, workers)
    with progress.status('testing on held-out data'):
        checkpoint = validation.checkpoint(0, trainers)
        about = {**checkpoint.training, 'teacher': str(options.teacher)}
        student = PowerPredictionNetwork(replace(checkpoint, training=about), STUDENT)
        folder.save_model(0, student.checkpoint)
        recordings = load(given.paths, options.drives, anyway=True)
        found = compared(teacher, student, given, recordings)
        drives = [n for n in given.data.names if any(t.matches(n) for t in validation.types)]
        cost = {
            model.name: {str(n): policy_step_cost(model, drives, n) for n in options.robots}
            for model in (teacher, student)
        }
        folder.save_json(
            TABLE,
            {
                **table([found.smoothed]),
                'live': table([found.live])['models'],
                'student_against_teacher': dict(found.imitation),
                'us_per_robot_and_policy_step': cost,
            },
        )
        folder.finish(trainers)
    sizes = {TEACHER: teacher.checkpoint.config.hidden, STUDENT: options.hidden}
    _print(found, cost, sizes, len(drives))
    print(f'in a reward: BatchPower.load({f"ppn:{options.output}"!r}, drives, robots)')
    print(
        f'ros2 run power_estimator benchmark {shlex.quote(str(options.bags[0]))} --models '
        f'{shlex.quote(f"ppn:{options.teacher}")} {shlex.quote(f"ppn:{options.output}")}'
    )


def _print(
    found: DistillationResult,
    cost: Mapping[str, Mapping[str, float]],
    sizes: Mapping[str, int],
    drives: int,
) -> None:
    kinds = list(found.imitation)
    parts = [{one.name: one for one in part} for part in (found.smoothed, found.live)]
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
    title = f'R² on held-out data; µs per robot of {drives} drives and policy step'
    print_table(output(140), columns, rows, title)
    imitation = ', '.join(f'{kind} {r2:.3f}' for kind, r2 in found.imitation.items())
    print(f'student against teacher, R²: {imitation}')
