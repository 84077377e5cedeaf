"""`ros2 run policy_training evaluate`: evaluate policies on tasks; a table, JSON and a page."""

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from policy_runner.policies.by_name import by_short_name, load_policy
from power_estimator.loader import load_model
from power_recordings.reading.bag_folder import check_recordings
from rich.console import Console
from sim_bridge.plant.parameters import Plant
from wattwalk_core.console import output, print_table, progress, write_json
from wattwalk_core.errors import InputError
from wattwalk_core.files import together

from policy_training.evaluation.evaluate import evaluate
from policy_training.evaluation.measured_walk import recorded_walk
from policy_training.evaluation.report import PARTS, write_report
from policy_training.evaluation.tasks import parse_tasks
from policy_training.learning.run_folder import policy_source, read_curves


def run(options: argparse.Namespace) -> None:
    tasks = parse_tasks(options.tasks)
    if options.video is not None:
        options.video.mkdir(parents=True, exist_ok=True)
    named = by_short_name(options.policies)
    sources = {name: policy_source(source) for name, source in named.items()}
    for source in sources.values():
        load_policy(source, trust_code=options.trust_code)
    models = {spec: load_model(spec) for spec in options.models}
    plant = Plant.load(options.plant).unit(options.unit)
    bags = [_named_bag(text) for text in options.bags]
    check_recordings(path for _, path in bags)
    with progress('reading'):
        recorded = [recorded_walk(path, name) for name, path in bags]
    result, cycles = evaluate(sources, tasks, models, plant, options, recorded)
    curves = {name: read_curves(Path(source).parent) for name, source in sources.items()}
    with together():
        write_json(options.json, result)
        if options.report is not None:
            write_report(options.report, result, cycles, curves)
    _print(output(140), result)
    for written in (options.report, options.video):
        if written is not None:
            print(f'wrote {written}')


def _named_bag(text: str) -> tuple[str, Path]:
    name, equals, path = text.partition('=')
    if not equals or not name:
        raise InputError(f'--bags {text!r} is not NAME=BAG, such as pmp=bags/pmp_1')
    return name, Path(path)


def _print(console: Console, result: Mapping[str, Any]) -> None:
    errors = ('vx off', 'vy off', 'yaw off')
    rows = [
        (
            f'{entry["name"]}, {entry["task"]}',
            *(_number((entry['power_w'] or {}).get(part), 0) for part in ('supply', *PARTS)),
            _number(entry['estimated_w'], 0),
            *(_number(error, 2) for error in entry['tracking'].values()),
            _number(entry['cost_of_transport'], 2),
            str(entry['falls']),
        )
        for entry in result['policies']
    ]
    columns = ('policy, task', 'supply W', *PARTS, 'estimated', *errors, 'CoT', 'falls')
    print_table(console, columns, rows)
    for sentence in result['verdict']:
        console.print(sentence)


def _number(value: float | None, digits: int) -> str:
    return '–' if value is None else f'{value:.{digits}f}'
