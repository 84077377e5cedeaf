"""`ros2 run power_estimator replay`: any bag in, a bag of estimates out that plays beside it."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from statistics import fmean

from wattwalk_core.command import command, command_parser
from wattwalk_core.errors import InputError


@command
def main(args: Sequence[str] | None = None) -> int:
    """Entry point."""
    options = _parser().parse_args(args)

    from power_recordings.reading.bag_folder import check_recordings

    check_recordings([options.bag])

    from power_recordings.card import Card
    from power_recordings.messages.cdr import POWER_ESTIMATE
    from power_recordings.reading.reader import Recording
    from power_recordings.writing.writer import BagWriter
    from rich.console import Console
    from rich.progress import track

    from power_estimator.live.replay import estimates, messages
    from power_estimator.loader import load_model

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
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(
        'power_estimator replay',
        'Estimate the power of every drive in a recording, as the live node would.',
        'example: ros2 run power_estimator replay bags/walk --model ppn:runs/first '
        '-o bags/walk_estimate',
    )
    parser.add_argument('bag', type=Path, help='recording with what the model needs')
    parser.add_argument('--model', required=True, help='ppn:RUN, model.yaml, …')
    parser.add_argument('-o', '--output', type=Path, required=True, help='new bag')
    parser.add_argument('--overwrite', action='store_true', help='replace the output bag')
    return parser
