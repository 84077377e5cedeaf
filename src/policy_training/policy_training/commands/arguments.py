"""Arguments of the commands."""

import os
from argparse import ArgumentParser, Namespace
from pathlib import Path

from wattwalk_core.command import Arguments, entry_point
from wattwalk_core.console import ending
from wattwalk_core.errors import InputError

from policy_training.evaluation.tasks import TASKS

_EVALUATE = """\
A policy is a name (baseline, pmp, economy, trot, …), a policy folder or a training run.

examples:
  ros2 run policy_training evaluate --policies baseline pmp --report policies.html
  ros2 run policy_training evaluate --bags baseline=bags/b1 pmp=bags/p1 --json live.json
  ros2 run policy_training evaluate --policies runs/baseline runs/pmp --models ppn:runs/ppn \\
      --tasks forward turn strafe=0,0.3,0 --unit 2 --json policies.json
  ros2 run policy_training evaluate --policies pmp --tasks forward --trials 0 --video walks
"""


@entry_point(
    'policy_training.commands.evaluate:run',
    'Measure what policies draw on the simulated robot, and how well they walk.',
    _EVALUATE,
)
def evaluate(parser: ArgumentParser, args: Arguments) -> Namespace:
    add = parser.add_argument
    add('--policies', nargs='+', default=[], metavar='DIR', help='names, folders or runs')
    add('--bags', nargs='+', default=[], metavar='NAME=BAG', help='recordings of running nodes')
    tasks = tuple(task.name for task in TASKS)
    add('--tasks', nargs='+', default=tasks, metavar='TASK', help='NAME or NAME=VX,VY,YAW')
    add('--models', nargs='+', default=[], metavar='MODEL', help='power models to estimate with')
    add('--duration', type=float, default=12.0, metavar='S', help='of each task')
    add('--seed', type=int, default=1, help='of noise and ground')
    plant = 'anymal_c_published'
    add('--plant', default=plant, metavar='FILE', help='plant file, or a shipped plant')
    add('--unit', type=int, default=0, metavar='N', help='which unit of the robot')
    add('--rough', action='store_true', help='on rough ground rather than level')
    add('--ideal', action='store_true', help='give policies the true state, not what sensors read')
    add('--trials', type=int, default=64, metavar='N', help='robots on rough ground; 0: none')
    add('--threads', type=int, default=0, metavar='N', help='of the trials; 0: one per core')
    add('--trust-code', action='store_true', help='run TorchScript files, which are code')
    add('--json', type=Path, metavar='F', help='write the figures')
    add('--report', type=ending('--report', '.html'), metavar='F.html', help='write a page')
    add('--video', type=Path, metavar='DIR', help='write each walk as a picture beside its watts')
    options = parser.parse_args(args)
    if not 5.0 <= options.duration <= 600.0:
        raise InputError(f'--duration is {options.duration!r}; give 5..600 s')
    if not options.policies and not options.bags:
        raise InputError('nothing to evaluate; name policies, or recordings with --bags')
    if options.trials < 0 or options.unit < 0 or options.seed < 0:
        raise InputError('--trials, --unit and --seed must not be negative')
    if options.video is not None and 'DISPLAY' not in os.environ:
        os.environ.setdefault('MUJOCO_GL', 'egl')  # before mujoco is imported
    return options


_EXPORT = """\
POLICY is a shipped one (baseline, pmp, economy), a policy folder or a training run.
FILE.yaml beside FILE.pt is its contract: what the observation holds, in which scale and order,
joints, default pose, action scale, gains and rate.

examples:
  ros2 run policy_training export pmp -o pmp.pt
  ros2 run policy_runner run --policy pmp.pt --trust-code
"""


@entry_point(
    'policy_training.commands.export:run',
    'Write a learned policy as TorchScript, from observations [N, size] to actions [N, 12].',
    _EXPORT,
)
def export(parser: ArgumentParser, args: Arguments) -> Namespace:
    add = parser.add_argument
    add('policy', metavar='POLICY', help='name, folder or run')
    add('-o', '--output', type=ending('--output', '.pt'), required=True, metavar='FILE.pt')
    return parser.parse_args(args)


_TRAIN = """\
examples:
  ros2 run policy_training train --config baseline --steps 50e6 -o runs/start
  ros2 run policy_training train --config baseline --from runs/start --steps 30e6 -o runs/baseline
  ros2 run policy_training train --config pmp --from runs/start --power ppn:RUN -o runs/pmp
  ros2 run policy_training train --resume -o runs/pmp
  tensorboard --logdir runs
"""


@entry_point(
    'policy_training.commands.train:run',
    'Train a walking policy with PPO, with predicted power in its reward.',
    _TRAIN,
)
def train(parser: ArgumentParser, args: Arguments) -> Namespace:
    add = parser.add_argument
    add('--config', default='baseline', help='file, or a shipped one: baseline, pmp, economy')
    add('-o', '--output', type=Path, required=True, metavar='RUN', help='folder of the run')
    add('--resume', action='store_true', help='go on with the run in that folder')
    add('--from', dest='source', type=Path, metavar='RUN', help="start from a run's networks")
    add('--seed', type=int, help='of everything random')
    add('--steps', type=float, help='policy steps of all environments together')
    add('--power', metavar='MODEL', help='ppn:RUN, a YAML of effects, mechanical_power, plant')
    add('--weight', type=float, metavar='W', help='of the power term, per watt; the paper: 4e-4')
    add('--environments', type=int, metavar='N', help='robots that learn at the same time')
    add('--threads', type=int, metavar='N', help='0: one per core; 1 beside other work')
    add('--set', nargs='+', action='extend', default=[], metavar='KEY=VALUE', help="the config's")
    add('--device', default='cpu', help='cpu or cuda, of the network and its learning')
    add('--seconds', type=float, help='stop after so long; --resume goes on')
    return parser.parse_args(args)
