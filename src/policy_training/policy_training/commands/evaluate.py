"""`ros2 run policy_training evaluate`: evaluate policies on tasks; a table, JSON and a page."""

import argparse
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from wattwalk_core.command import command, command_parser
from wattwalk_core.console import check_suffix, output, print_table, progress, write_json
from wattwalk_core.errors import InputError
from wattwalk_core.files import together

from policy_training.config import POLICY
from policy_training.evaluation.tasks import TASKS, parse_tasks

if TYPE_CHECKING:
    from rich.console import Console

_EPILOG = """\
A policy is a name (baseline, economy, trot, …), a policy folder or a training run.

examples:
  ros2 run policy_training evaluate --policies baseline pmp --report policies.html
  ros2 run policy_training evaluate --bags baseline=bags/b1 pmp=bags/p1 --json live.json
  ros2 run policy_training evaluate --policies runs/baseline runs/pmp --models ppn:runs/ppn \\
      --tasks forward turn strafe=0,0.3,0 --unit 2 --json policies.json
  ros2 run policy_training evaluate --policies pmp --tasks forward --trials 0 --video walks
"""
_DEFAULT_TASKS: Final = tuple(task.name for task in TASKS)


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(
        'policy_training evaluate',
        'Measure what policies draw on the simulated robot, and how well they walk.',
        _EPILOG,
    )
    add = parser.add_argument
    add('--policies', nargs='+', default=[], metavar='DIR', help='names, folders or runs')
    add('--bags', nargs='+', default=[], metavar='NAME=BAG', help='recordings of running nodes')
    add(
        '--tasks', nargs='+', default=_DEFAULT_TASKS, metavar='TASK', help='NAME or NAME=VX,VY,YAW'
    )
    add('--models', nargs='+', default=[], metavar='MODEL', help='power models to estimate with')
    add('--duration', type=float, default=12.0, metavar='S', help='of each task')
    add('--seed', type=int, default=1, help='of noise and ground')
    add('--plant', default='anymal_c', metavar='FILE', help='plant file, or a shipped plant')
    add('--unit', type=int, default=0, metavar='N', help='which unit of the robot')
    add('--rough', action='store_true', help='on rough ground rather than level')
    add('--trials', type=int, default=64, metavar='N', help='robots on rough ground; 0: none')
    add('--threads', type=int, default=0, metavar='N', help='of the trials; 0: one per core')
    add('--trust-code', action='store_true', help='run TorchScript files, which are code')
    add('--json', type=Path, metavar='F', help='write the figures')
    add('--report', type=Path, metavar='F.html', help='write a page')
    add('--video', type=Path, metavar='DIR', help='write each walk as a picture beside its watts')
    return parser


@command
def main(args: Sequence[str] | None = None) -> int:
    """Entry point."""
    options = _parser().parse_args(args)
    if not 5.0 <= options.duration <= 600.0:
        raise InputError(f'--duration is {options.duration!r}; give 5..600 s')
    if not options.policies and not options.bags:
        raise InputError('nothing to evaluate; name policies, or recordings with --bags')
    if options.trials < 0 or options.unit < 0 or options.seed < 0:
        raise InputError('--trials, --unit and --seed must not be negative')
    check_suffix(options.report, '--report', ('.html',))
    tasks = parse_tasks(options.tasks)
    if options.video is not None:
        options.video.mkdir(parents=True, exist_ok=True)
        if 'DISPLAY' not in os.environ:
            os.environ.setdefault('MUJOCO_GL', 'egl')  # before mujoco is imported

    from policy_runner.policies.by_name import load_policy
    from power_estimator.loader import load_model
    from power_recordings.reading.bag_folder import check_recordings
    from sim_bridge.plant.parameters import Plant

    from policy_training.learning.run_folder import policy_source, read_curves

    sources = {_name(source): policy_source(source) for source in options.policies}
    if len(sources) < len(options.policies):
        raise InputError(f'two policies are called the same among {", ".join(options.policies)}')
    for source in sources.values():
        load_policy(source, trust_code=options.trust_code)
    models = {spec: load_model(spec) for spec in options.models}
    plant = Plant.load(options.plant).unit(options.unit)
    bags = [_named_bag(text) for text in options.bags]
    check_recordings(path for _, path in bags)

    from policy_training.evaluation.evaluate import evaluate
    from policy_training.evaluation.measured_walk import recorded_walk
    from policy_training.evaluation.report import write_report

    with progress('reading'):
        recorded = [recorded_walk(path, name) for name, path in bags]
    result, cycles = evaluate(sources, tasks, models, plant, options, recorded)
    curves = {name: read_curves(Path(source).parent) for name, source in sources.items()}
    _print(output(140), result)
    with together():
        if options.json is not None:
            write_json(options.json, result)
        if options.report is not None:
            write_report(options.report, result, cycles, curves)
    for written in (options.report, options.video):
        if written is not None:
            print(f'wrote {written}')
    return 0


def _named_bag(text: str) -> tuple[str, Path]:
    name, equals, path = text.partition('=')
    if not equals or not name:
        raise InputError(f'--bags {text!r} is not NAME=BAG, such as pmp=bags/pmp_1')
    return name, Path(path)


def _name(source: str) -> str:
    path = Path(source)
    return path.parent.name if path.name == POLICY else path.name


def _print(console: 'Console', result: Mapping[str, Any]) -> None:
    parts = ('electronics', 'idle', 'HAA', 'HFE', 'KFE')
    errors = ('vx off', 'vy off', 'yaw off')
    rows = []
    for entry in result['policies']:
        power = entry['power_w'] or {}
        rows.append(
            (
                f'{entry["name"]}, {entry["task"]}',
                *(_number(power.get(part), 0) for part in ('supply', *parts)),
                _number(entry['estimated_w'], 0),
                *(_number(error, 2) for error in entry['tracking'].values()),
                _number(entry['cost_of_transport'], 2),
                str(entry['falls']),
            )
        )
    columns = ('policy, task', 'supply W', *parts, 'estimated', *errors, 'CoT', 'falls')
    print_table(console, columns, rows)
    for sentence in result['verdict']:
        console.print(sentence)


def _number(value: float | None, digits: int) -> str:
    return '–' if value is None else f'{value:.{digits}f}'
