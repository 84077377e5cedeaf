"""`ros2 run power_estimator export`: a network as a reward term for the training of others."""

import argparse
from pathlib import Path

from power_estimator.network.checkpoint import Checkpoint
from power_estimator.portable.export import export


def run(options: argparse.Namespace) -> None:
    model = Path(str(options.model).removeprefix('ppn:'))
    checkpoint = Checkpoint.load(model)
    for file in export(checkpoint, options.output, options.drives, options.sample_rate):
        print(f'wrote {file}')
    given = f"'{options.output}/power_term.safetensors', joint_names, {options.sample_rate:g}"
    print(f'in a training: PowerTerm.load({given})')
