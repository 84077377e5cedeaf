"""Arguments of the commands."""

from argparse import ArgumentParser, Namespace
from pathlib import Path

from power_recordings.commands.arguments import add_doubts
from wattwalk_core.command import Arguments, entry_point, node_options
from wattwalk_core.console import PICTURES, ending
from wattwalk_core.engine.options import add_workplace
from wattwalk_core.errors import InputError

from power_estimator.network.checkpoint import NetworkConfig
from power_estimator.proxies import PROXIES
from power_estimator.training.trainer_config import TrainerConfig


def add_training(parser: ArgumentParser, *, epochs: int = TrainerConfig.epochs) -> None:
    """Add the arguments of a training to a parser: recordings, run folder, settings."""
    add = parser.add_argument
    add('bags', nargs='+', type=Path, metavar='BAG', help='recordings with measured drives')
    add('-o', '--output', type=Path, required=True, metavar='RUN', help='new run folder')
    add('--drives', nargs='+', default=[], metavar='NAME', help='names or patterns, as *_KFE')
    add('--epochs', type=int, default=epochs, help=f'at most, per network ({epochs})')
    add('--seed', type=int, default=0, help='the same seed gives the same networks')
    add('--resume', action='store_true', help='continue a run that was stopped')


def add_cross_validation(parser: ArgumentParser, *, folds: int) -> None:
    """Add the arguments of a cross-validation to a parser: drive types, split, figures' style."""
    add = parser.add_argument
    add('--folds', type=int, default=folds, help=f'folds of the cross-validation ({folds})')
    add('--segments', type=int, default=6, help='segments that are each split 80/10/10 (6)')
    add('--type', action='append', metavar='NAME=PATTERN', help='a drive type; default by name')
    add('--dark', action='store_true', help='figures on a dark ground')


_MODELS = (
    'ppn:RUN, model.yaml, proxy, plain (shaft + copper loss + idle), or recorded (the live '
    'estimate in the recording)'
)


@entry_point(
    'power_estimator.commands.benchmark:run',
    'Compare power models on recordings: R², errors in W and in energy, all on samples that '
    'they were not fitted to. Proxies are ' + ', '.join(PROXIES) + '.',
    'example: ros2 run power_estimator benchmark bags/walk --models ppn:runs/first '
    'torque_squared mechanical_power --json benchmark.json',
)
def benchmark(parser: ArgumentParser, args: Arguments) -> Namespace:
    add = parser.add_argument
    add('bags', nargs='+', type=Path, metavar='BAG', help='recordings with measured drives')
    add('--models', nargs='+', required=True, metavar='MODEL', help=_MODELS)
    add('--drives', nargs='+', default=[], metavar='NAME', help='names or patterns, as *_KFE')
    add_doubts(parser)
    add('--json', type=Path, metavar='FILE', help='write the table there')
    picture = ending('--picture', *PICTURES)
    add('--picture', type=picture, metavar='PNG', help='draw the estimates and the R² there')
    add('--dark', action='store_true', help='pictures on a dark ground')
    return parser.parse_args(args)


@entry_point(
    'power_estimator.commands.distil:run',
    'Train a small network on the outputs of a trained one, and compare their R² and '
    'their cost per policy step of 20 ms with many robots. The result is a run folder like '
    'any other.',
    'example: ros2 run power_estimator distil runs/paper bags/paper/* -o runs/small --hidden 32',
)
def distil(parser: ArgumentParser, args: Arguments) -> Namespace:
    add = parser.add_argument
    add('teacher', type=Path, metavar='TEACHER', help='run folder or file of the trained network')
    add_training(parser)
    add_workplace(parser, 'networks', scheduler=False)
    add('--hidden', type=int, default=32, help='hidden units of the small network (32)')
    robots = (64, 512, 4096)
    add('--robots', nargs='+', type=int, default=robots, help='side by side, for the cost')
    return parser.parse_args(args)


_EXPORT = """\
The folder holds power_term.py (plain torch, with a reward term for mjlab and Isaac Lab) and
power_term.safetensors (its tensors); neither needs wattwalk. With --drives there is a TorchScript
file too, for which the order of the drives is fixed.

examples:
  ros2 run power_estimator export runs/ppn_reward -o power_term
  ros2 run power_estimator export runs/arm -o power_term --drives shoulder elbow --sample-rate 50
"""


@entry_point(
    'power_estimator.commands.export:run',
    'Write a trained network as a module of plain torch, for the reward of any simulator.',
    _EXPORT,
)
def export(parser: ArgumentParser, args: Arguments) -> Namespace:
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
    options = parser.parse_args(args)
    if options.output.exists() and not options.output.is_dir():
        raise InputError(f'{options.output} is a file; give a folder')
    return options


@entry_point(
    'power_estimator.commands.replay:run',
    'Estimate the power of every drive in a recording, as the live node would.',
    'example: ros2 run power_estimator replay bags/walk --model ppn:runs/first '
    '-o bags/walk_estimate',
)
def replay(parser: ArgumentParser, args: Arguments) -> Namespace:
    parser.add_argument('bag', type=Path, help='recording with what the model needs')
    parser.add_argument('--model', required=True, help='ppn:RUN, model.yaml, …')
    parser.add_argument('-o', '--output', type=Path, required=True, help='new bag')
    parser.add_argument('--overwrite', action='store_true', help='replace the output bag')
    return parser.parse_args(args)


HIDDEN = (8, 16, 32, 64, 100, 150)
HISTORY = (0.02, 0.05, 0.1, 0.2, 0.3, 0.5)


@entry_point(
    'power_estimator.commands.sweep:run',
    'Train networks of several sizes (with carried state) and, at 100 units, of '
    'several histories (windowed), test them on the same held-out data, and draw where more '
    'no longer helps. Costs are µs per sample of twelve drives on this machine.',
    'example: ros2 run power_estimator sweep bags/paper/* -o runs/sweep '
    '--hidden 16 32 64 100 150 --history 0.05 0.1 0.2 0.3 0.5',
)
def sweep(parser: ArgumentParser, args: Arguments) -> Namespace:
    add_training(parser, epochs=12)
    add_workplace(parser, 'networks')
    add_cross_validation(parser, folds=1)
    add = parser.add_argument
    add('--hidden', nargs='+', type=int, default=HIDDEN, metavar='N', help='hidden units')
    add('--history', nargs='+', type=float, default=HISTORY, metavar='S', help='seconds')
    return parser.parse_args(args)


@entry_point(
    'power_estimator.commands.train:run',
    'Train a Power Prediction Network per drive type on recordings and test it '
    'and the usual proxies on held-out parts of them.',
    'example: ros2 run power_estimator train bags/walk_1 bags/walk_2 -o runs/first',
)
def train(parser: ArgumentParser, args: Arguments) -> Namespace:
    add_training(parser)
    add_workplace(parser, 'networks')
    add_cross_validation(parser, folds=6)
    add = parser.add_argument
    add('--hidden', type=int, default=NetworkConfig.hidden, help='hidden units (100)')
    add('--history', type=float, default=0.3, help='seconds of the windowed form (0.3)')
    return parser.parse_args(args)


_ESTIMATE = """
example, with a network trained before:
  ros2 run power_estimator estimate --ros-args -p model:=ppn:runs/first
example, against the measurement, shown on diagnostics:
  ros2 run power_estimator estimate --ros-args -p model:=ppn:runs/first -p compare:=true
"""


@entry_point(
    'power_estimator.live.node:run',
    'Estimates the electrical power of every drive at 50 Hz from joint_states and joint_commands.',
    _ESTIMATE,
)
def estimate(parser: ArgumentParser, args: Arguments) -> Namespace:
    return node_options(parser, args)
