"""`ros2 run power_estimator train`: recordings in, a run folder with networks and a table out."""

import argparse
import shlex
from dataclasses import asdict

from power_recordings.reading.bag_folder import check_recordings
from rich.console import Console
from wattwalk_core.engine.options import Workplace

from power_estimator import recordings
from power_estimator.drive_types import infer_types, parse_types
from power_estimator.evaluation import figure
from power_estimator.evaluation.benchmark import print_scores, table
from power_estimator.evaluation.traces import traces
from power_estimator.judge.judge import Judge
from power_estimator.judge.recordings import load
from power_estimator.network.checkpoint import NetworkConfig
from power_estimator.training.cross_validation import CrossValidation
from power_estimator.training.on_workers import engine_of, train_on_workers
from power_estimator.training.progress_bars import training_bars
from power_estimator.training.protocol import Protocol
from power_estimator.training.run_folder import TABLE, NetworkRunFolder
from power_estimator.training.trainer_config import TrainerConfig

TRACES = 'traces.png'
BARS = 'r2.png'


def run(options: argparse.Namespace) -> None:
    place = Workplace.of(options)
    config = NetworkConfig(hidden=options.hidden, history=round(options.history * 200))
    training = TrainerConfig(epochs=options.epochs, seed=options.seed)
    protocol = Protocol(options.segments, options.folds, config.history)
    check_recordings(options.bags)
    progress = Console(stderr=True)
    with progress.status('reading and aligning'):
        given = recordings.training_set(options.bags, options.drives)
        types = parse_types(options.type) if options.type else infer_types(given.data.names)
        validation = CrossValidation.of(
            given, types, network=config, training=training, protocol=protocol
        )
    for note in validation.data.notes:
        progress.print(note, highlight=False)
    folder = NetworkRunFolder(options.output)
    about = {
        'types': {t.name: list(t.patterns) for t in validation.types},
        'drives': list(validation.data.names),
        'network': asdict(config),
        'training': asdict(training),
        'protocol': asdict(protocol),
    }
    folder.open(about, validation.recordings, resume=options.resume)
    print(
        f'{len(options.bags)} recordings, {len(validation.data.time) / config.rate:.0f} s; '
        f'{", ".join(t.name for t in validation.types)}; {len(validation.jobs)} networks of '
        f'{config.hidden} units'
    )
    jobs = [job.name for job in validation.jobs]
    with (
        engine_of(place) as engine,
        training_bars(progress, jobs, training.epochs, folder.path) as show,
    ):
        if engine is None:
            trainers = validation.run(folder, show, place.processes(len(jobs)))
        else:
            trainers = train_on_workers(engine, given, validation, folder, show)
    with progress.status('testing on held-out data'):
        judge = Judge(load(options.bags, options.drives, anyway=True))
        tests = []
        for fold in range(protocol.folds):
            checkpoint = validation.checkpoint(fold, trainers)
            folder.save_model(fold, checkpoint)
            tests.append(validation.test(checkpoint, judge))
        result = table(tests)
        title = f'held-out data, {len(tests)} fold{"s" if len(tests) > 1 else ""}'
        shown = traces(judge, tests[0])
        figure.draw_traces(folder.path / TRACES, shown, dark=options.dark)
        figure.draw_bars(folder.path / BARS, result, title=title, dark=options.dark)
        folder.save_json(TABLE, result)
        folder.finish(trainers)
    print_scores(result, title)
    print(f'pictures: {folder.path / TRACES}, {folder.path / BARS}; table: {folder.path / TABLE}')
    model = shlex.quote(f'ppn:{options.output}')
    bag, estimate = shlex.quote(str(options.bags[0])), shlex.quote(f'{options.bags[0]}_estimate')
    print('next, live beside the robot or a playing bag:')
    print(f'  ros2 run power_estimator estimate --ros-args -p model:={model}')
    print('or a recording through the live estimator:')
    print(f'  ros2 run power_estimator replay {bag} --model {model} -o {estimate}')
