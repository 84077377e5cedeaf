"""`ros2 run power_estimator export`: a network as a reward term for the training of others."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from wattwalk_core.command import command, command_parser
from wattwalk_core.errors import InputError

_EPILOG = """\
The folder holds power_term.py (plain torch, with a reward term for mjlab and Isaac Lab) and
power_term.safetensors (its tensors); neither needs wattwalk. With --drives there is a TorchScript
file too, for which the order of the drives is fixed.

examples:
  ros2 run power_estimator export runs/ppn_reward -o power_term
  ros2 run power_estimator export runs/arm -o power_term --drives shoulder elbow --sample-rate 50
"""


@command
def main(args: Sequence[str] | None = None) -> int:
    """Entry point."""
    options = _parser().parse_args(args)
    if options.output.exists() and not options.output.is_dir():
        raise InputError(f'{options.output} is a file; give a folder')

    from power_estimator.network.checkpoint import Checkpoint
    from power_estimator.portable.export import export

    model = Path(str(options.model).removeprefix('ppn:'))
    checkpoint = Checkpoint.load(model)
    for file in export(checkpoint, options.output, options.drives, options.sample_rate):
        print(f'wrote {file}')
    print(f"in a training: PowerTerm.load('{options.output}/power_term.safetensors', joint_names)")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(
        'power_estimator export',
        'Write a trained network as a module of plain torch, for the reward of any simulator.',
        _EPILOG,
    )
    add = parser.add_argument
    add('model', metavar='RUN', help='run folder or file of a network; see distil for a small one')
    add('-o', '--output', type=Path, required=True, metavar='DIR', help='folder to write')
    add('--drives', nargs='+', default=(), metavar='NAME', help='columns of the TorchScript file')
    add(
        '--sample-rate',
        type=float,
        default=200.0,
        metavar='HZ',
        help='of the samples that the TorchScript file takes (200)',
    )
    return parser
