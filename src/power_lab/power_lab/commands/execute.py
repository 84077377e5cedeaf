"""`ros2 run power_lab execute`: the recording that a diagnosis asked for, on the bench."""

import argparse

from sim_bridge.plant.parameters import Plant

from power_lab.challenge.bench_recording import record_motion


def run(options: argparse.Namespace) -> None:
    drive, seconds = record_motion(
        options.motion,
        options.output,
        Plant.load(options.plant),
        drive=options.drive or '',
        challenge=options.challenge,
        unit=options.unit,
        seed=options.seed,
        overwrite=options.overwrite,
        progress=True,
    )
    print(f'wrote {options.output}: {seconds:.0f} s of {drive}')
