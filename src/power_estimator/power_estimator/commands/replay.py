"""`ros2 run power_estimator replay`: any bag in, a bag of estimates out that plays beside it."""

import argparse
from statistics import fmean

from power_recordings.card import Card
from power_recordings.messages.cdr import POWER_ESTIMATE
from power_recordings.reading.bag_folder import check_recordings
from power_recordings.reading.reader import Recording
from power_recordings.writing.writer import BagWriter
from rich.console import Console
from rich.progress import track
from wattwalk_core.errors import InputError

from power_estimator.live.replay import estimates, messages
from power_estimator.loader import load_model


def run(options: argparse.Namespace) -> None:
    check_recordings([options.bag])
    console = Console(stderr=True)
    model = load_model(options.model)
    recording = Recording.open(options.bag)
    for problem in recording.problems:
        console.print(f'{options.bag}: {problem}', highlight=False)
    drives, results = estimates(recording, model)
    expected = round(recording.duration * 50)
    made = list(track(results, 'estimating', total=expected, console=console, transient=True))
    if not made:
        inputs = ', '.join(model.needs.inputs)
        raise InputError(f'{options.bag}: never has all of {inputs} at once')
    card = recording.card
    with BagWriter(options.output, overwrite=options.overwrite) as bag:
        topic = bag.add_topic('power_estimate', POWER_ESTIMATE)
        encoded = messages(made, drives, options.model)
        for estimate, cdr in zip(made, encoded, strict=True):
            bag.write(topic, estimate.stamp, cdr)
    notes = f'power_estimate of {options.model} for {options.bag.resolve().name}'
    Card(robot=card.robot, unit=card.unit, controller=card.controller, notes=notes).save(
        options.output
    )
    known = [e.total for e in made if e.status == 0]
    mean = f'{fmean(known):.1f} W in the mean' if known else 'all within the warm-up'
    print(f'{len(made)} estimates of {len(drives)} drives, {mean}')
    print('both at once, where ROS 2 is installed:')
    print(f'  ros2 bag play {options.bag} & ros2 bag play {options.output}')
