"""`ros2 run policy_training evaluate`: policies on tasks, measured; a table, JSON and a page."""

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from policy_runner.policies.by_name import SHIPPED, load_policy
from policy_runner.policies.folder import read_folder
from policy_runner.policies.learned import LearnedPolicy
from policy_runner.policies.perceptron import Perceptron
from power_estimator.evaluation.tables import terminal
from power_estimator.loader import load_model
from power_estimator.model import PowerModel
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table
from sim_bridge.plant.parameters import Plant
from wattwalk_core.command import command
from wattwalk_core.errors import InputError
from wattwalk_core.files import write_whole

from policy_training.evaluation.gait_cycle import Cycle, cycle_of
from policy_training.evaluation.measured_walk import Walk, idle_power, measure_walk, recorded_walk
from policy_training.evaluation.report import write_report
from policy_training.evaluation.robustness import (
    RobustnessConfig,
    RobustnessResult,
    evaluate_robustness,
)
from policy_training.evaluation.scores import score
from policy_training.evaluation.tasks import TASKS, Task, parse_tasks
from policy_training.evaluation.verdict import verdict
from policy_training.learning.run_folder import POLICY, read_curves

_EPILOG = """\
A policy is a name (baseline, pmp, pmp_heavy, trot), a policy folder or a training run.

examples:
  ros2 run policy_training evaluate --policies baseline pmp --report policies.html
  ros2 run policy_training evaluate --bags baseline=bags/b1 pmp=bags/p1 --json live.json
  ros2 run policy_training evaluate --policies runs/baseline runs/pmp --models ppn:runs/ppn \\
      --tasks forward turn strafe=0,0.3,0 --unit 2 --json policies.json
"""
_DEFAULT_TASKS: Final = tuple(task.name for task in TASKS)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='ros2 run policy_training evaluate',
        description='Measure what policies draw on the simulated robot, and how well they walk.',
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
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
    tasks = parse_tasks(options.tasks)
    sources = {_name(source): resolve(source) for source in options.policies}
    if len(sources) < len(options.policies):
        raise InputError(f'two policies are called the same among {", ".join(options.policies)}')
    for source in sources.values():
        load_policy(source, trust_code=options.trust_code)
    models = {spec: load_model(spec) for spec in options.models}
    plant = Plant.load(options.plant).unit(options.unit)
    with Console(stderr=True).status('reading'):
        recorded = [_recorded(text) for text in options.bags]
    result, cycles = evaluate(sources, tasks, models, plant, options, recorded)
    curves = {name: read_curves(Path(source).parent) for name, source in sources.items()}
    _print(terminal(), result)
    if options.json is not None:
        write_whole(options.json, json.dumps(result, indent=1, allow_nan=False) + '\n')
    if options.report is not None:
        write_report(options.report, result, cycles, curves)
        print(f'wrote {options.report}')
    return 0


def resolve(source: str) -> str:
    """The policy folder of a training run; anything else as it is."""
    inner = Path(source) / POLICY
    return str(inner) if inner.is_dir() else source


def evaluate(
    sources: Mapping[str, str],
    tasks: Sequence[Task],
    models: Mapping[str, PowerModel],
    plant: Plant,
    options: argparse.Namespace,
    recorded: Sequence[Walk] = (),
) -> tuple[dict[str, Any], dict[str, dict[str, Cycle]]]:
    """The JSON's content, and gait cycles by task and policy."""
    entries: list[dict[str, Any]] = []
    cycles: dict[str, dict[str, Cycle]] = {}
    trials: dict[str, Any] = {}
    bar = Progress(
        TextColumn('{task.description}'),
        BarColumn(),
        TextColumn('{task.completed:.0f} of {task.total:.0f}'),
        TimeElapsedColumn(),
        console=Console(stderr=True),
    )
    with bar:
        each = len(tasks) + bool(options.trials)
        work = bar.add_task('idle', total=len(sources) * each + len(recorded) + 1)
        idle = idle_power(plant)
        bar.advance(work)
        for walk in recorded:
            entries.append(score(walk, idle, models))
            cycle = cycle_of(walk)
            if cycle is not None:
                cycles.setdefault(walk.task.name, {})[walk.policy] = cycle
            bar.advance(work)
        for name, source in sources.items():
            for task in tasks:
                bar.update(work, description=f'{name}: {task.name}')
                walk = measure_walk(
                    source,
                    task,
                    plant,
                    duration=options.duration,
                    seed=options.seed,
                    on_rough=options.rough,
                    trust_code=options.trust_code,
                )
                entries.append({**score(walk, idle, models), 'name': name})
                cycle = cycle_of(walk)
                if cycle is not None:
                    cycles.setdefault(task.name, {})[name] = cycle
                bar.advance(work)
            if options.trials:
                bar.update(work, description=f'{name}: {options.trials} robots')
                found = _trials(source, options)
                if found is not None:
                    trials[name] = found.content()
                bar.advance(work)
    result = {
        'plant': plant.name,
        'unit': plant.unit_number,
        'ground': 'rough' if options.rough else 'flat',
        'policies': entries,
        'trials': trials,
    }
    result['verdict'] = verdict(entries, trials)
    return result, cycles


def _recorded(text: str) -> Walk:
    name, equals, path = text.partition('=')
    if not equals or not name:
        raise InputError(f'--bags {text!r} is not NAME=BAG, such as pmp=bags/pmp_1')
    return recorded_walk(Path(path), name)


def _trials(source: str, options: argparse.Namespace) -> RobustnessResult | None:
    """Robustness of a learned policy; None for a scripted one or a TorchScript file."""
    if Path(source).is_file() or not isinstance(load_policy(source), LearnedPolicy):
        return None
    folder = Path(source) if Path(source).is_dir() else SHIPPED / source
    contract, tensors = read_folder(folder)
    network = Perceptron(tensors, contract.network.activation)
    config = RobustnessConfig(robots=options.trials, seed=1000 + options.seed)
    return evaluate_robustness(contract, network, config, threads=options.threads)


def _name(source: str) -> str:
    path = Path(source)
    return path.parent.name if path.name == POLICY else path.name


def _print(console: Console, result: Mapping[str, Any]) -> None:
    table = Table(box=SIMPLE_HEAD)
    for column in ('policy', 'task'):
        table.add_column(column, no_wrap=True)
    for column in (
        *('supply W', 'electronics', 'idle', 'HAA', 'HFE', 'KFE', 'estimated'),
        *('vx off', 'vy off', 'yaw off', 'CoT', 'falls'),
    ):
        table.add_column(column, justify='right', no_wrap=True)
    for e in result['policies']:
        power = e['power_w'] or {}
        keys = ('supply', 'electronics', 'idle', 'HAA', 'HFE', 'KFE')
        table.add_row(
            e['name'],
            e['task'],
            *(_number(power.get(key), 0) for key in keys),
            _number(e['estimated_w'], 0),
            *(_number(e['tracking'][key], 2) for key in ('vx', 'vy', 'yaw')),
            _number(e['cost_of_transport'], 2),
            str(e['falls']),
        )
    console.print(table)
    for sentence in result['verdict']:
        console.print(sentence)


def _number(value: float | None, digits: int) -> str:
    return '–' if value is None else f'{value:.{digits}f}'
