"""`ros2 run power_estimator distil`: a small network from a trained one, for use in rewards."""

import argparse
import os
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wattwalk_core.command import command

from power_estimator.training.run_folder import CURVES, TABLE, NetworkRunFolder
from power_estimator.training.trainer_config import TrainerConfig

if TYPE_CHECKING:
    from rich.console import Console

    from power_estimator.training.cross_validation import Job
    from power_estimator.training.distillation import DistillationResult
    from power_estimator.training.trainer import Trainer


@command
def main(args: Sequence[str] | None = None) -> int:
    """Entry point."""
    options = _parser().parse_args(args)

    from rich.console import Console

    from power_estimator import recordings
    from power_estimator.evaluation.comparison import table
    from power_estimator.evaluation.cost import policy_step_cost
    from power_estimator.evaluation.tables import TrainingBars, terminal
    from power_estimator.network.ppn import PowerPredictionNetwork
    from power_estimator.training.distillation import (
        STUDENT,
        TEACHER,
        Distillation,
        in_order_of,
    )

    progress = Console(stderr=True)
    teacher = PowerPredictionNetwork.load(options.teacher)
    training = TrainerConfig(epochs=options.epochs, seed=options.seed)
    with progress.status('reading and aligning'):
        given = recordings.training_set(in_order_of(teacher, options.bags), options.drives)
        distillation = Distillation(teacher, given, hidden=options.hidden, training=training)
    validation = distillation.validation
    folder = NetworkRunFolder(options.output)
    about: dict[str, Any] = {
        'teacher': str(options.teacher),
        'types': {t.name: list(t.patterns) for t in validation.types},
        'network': asdict(validation.config),
        'training': asdict(training),
    }
    cards = [asdict(recording) for recording in validation.recordings]
    (folder.resume if options.resume else folder.start)(about, cards)
    try:
        with TrainingBars(
            progress, [job.name for job in validation.jobs], training.epochs
        ) as bars:

            def show(job: 'Job', trainer: 'Trainer') -> None:
                last = trainer.history[-1]
                bars.show(job.name, last.number, last.loss, last.r2, trainer.done)

            trainers = validation.run(folder, show, options.workers)
    except KeyboardInterrupt:
        print(f'stopped; {options.output} goes on with the same command and --resume')
        raise
    with progress.status('testing on held-out data'):
        checkpoint = distillation.checkpoint(trainers, str(options.teacher))
        folder.save_model(0, checkpoint)
        found = distillation.test(checkpoint)
        student = PowerPredictionNetwork(checkpoint, STUDENT)
        drives = [n for n in given.data.names if any(t.matches(n) for t in validation.types)]
        cost = {
            model.name: {str(n): policy_step_cost(model, drives, n) for n in options.robots}
            for model in (PowerPredictionNetwork(teacher.checkpoint, TEACHER), student)
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
        curves = {j.name: [asdict(epoch) for epoch in t.history] for j, t in trainers.items()}
        folder.save_json(CURVES, curves)
        folder.finish()
    sizes = {TEACHER: teacher.checkpoint.config.hidden, STUDENT: options.hidden}
    _print(terminal(), found, cost, sizes, len(drives))
    print(f'in a reward: BatchPower.load({f"ppn:{options.output}"!r}, drives, robots)')
    print(
        f'ros2 run power_estimator benchmark {shlex.quote(str(options.bags[0]))} --models '
        f'{shlex.quote(f"ppn:{options.teacher}")} {shlex.quote(f"ppn:{options.output}")}'
    )
    return 0


def _print(
    console: 'Console',
    found: 'DistillationResult',
    cost: Mapping[str, Mapping[str, float]],
    sizes: Mapping[str, int],
    drives: int,
) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    from power_estimator.training.distillation import STUDENT

    kinds = list(found.imitation)
    title = f'R² on held-out data; µs per robot of {drives} drives and policy step'
    view = Table(title=title, title_justify='left', box=SIMPLE_HEAD)
    robots = list(cost[STUDENT])
    for name in (
        'network',
        'units',
        *(f'{kind} R²' for kind in kinds),
        *(f'{kind} live' for kind in kinds),
        *(f'{n} robots' for n in robots),
    ):
        view.add_column(name, justify='left' if name == 'network' else 'right', no_wrap=True)
    for name, units in sizes.items():
        scores = [
            part[name].types[kind].r2 for part in (found.smoothed, found.live) for kind in kinds
        ]
        view.add_row(
            name,
            str(units),
            *(f'{score:.3f}' for score in scores),
            *(f'{cost[name][n]:.1f}' for n in robots),
        )
    console.print(view)
    said = ', '.join(f'{kind} {r2:.3f}' for kind, r2 in found.imitation.items())
    console.print(f'student against teacher, R²: {said}')


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='ros2 run power_estimator distil',
        description='Train a small network on the outputs of a trained one, and set both side by '
        'side: R² against the measured power, and what a policy step of 20 ms costs with many '
        'robots at once. The result is a run folder like any other.',
        epilog='example: ros2 run power_estimator distil runs/paper bags/paper/* -o runs/small '
        '--hidden 32',
    )
    add = parser.add_argument
    add('teacher', type=Path, metavar='RUN', help='run folder or file of the trained network')
    add('bags', nargs='+', type=Path, metavar='BAG', help='recordings, best those of its training')
    add('-o', '--output', type=Path, required=True, metavar='SMALL', help='new run folder')
    add('--hidden', type=int, default=32, help='hidden units of the small network (32)')
    add('--drives', nargs='+', default=[], metavar='NAME', help='names or patterns, as *_KFE')
    add('--epochs', type=int, default=TrainerConfig.epochs, help='at most, per network')
    add(
        '--robots', nargs='+', type=int, default=(64, 512, 4096), help='side by side, for the cost'
    )
    add('--seed', type=int, default=0, help='the same seed gives the same network')
    add('--workers', type=int, default=min(8, os.cpu_count() or 1), help='networks at a time')
    add('--resume', action='store_true', help='go on with a run that was stopped')
    return parser
