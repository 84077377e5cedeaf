"""Evaluation of policies: measured walks of each task, robustness, gait cycles and a verdict."""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from policy_runner.policies.blended_network import network_of
from policy_runner.policies.by_name import learned_folder
from policy_runner.policies.folder import read_folder
from policy_runner.policies.trot import TROTS
from power_estimator.model import PowerModel
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from sim_bridge.plant.parameters import Plant

from policy_training.evaluation.gait_cycle import Cycle, cycle_of
from policy_training.evaluation.measured_walk import MeasuredWalk, idle_power, measure_walk
from policy_training.evaluation.robustness import (
    RobustnessConfig,
    RobustnessResult,
    evaluate_robustness,
)
from policy_training.evaluation.scores import score_walk
from policy_training.evaluation.tasks import Task
from policy_training.evaluation.verdict import verdict


def evaluate(
    sources: Mapping[str, str],
    tasks: Sequence[Task],
    models: Mapping[str, PowerModel],
    plant: Plant,
    options: argparse.Namespace,
    recorded: Sequence[MeasuredWalk] = (),
) -> tuple[dict[str, Any], dict[str, dict[str, Cycle]]]:
    """Return the content of the JSON, and gait cycles by task and policy."""
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

    def add(walk: MeasuredWalk, name: str) -> None:
        entries.append({**score_walk(walk, idle, models), 'name': name})
        cycle = cycle_of(walk)
        if cycle is not None:
            cycles.setdefault(walk.task.name, {})[name] = cycle
        if options.video is not None:
            from policy_training.evaluation.video import Clip, write_video  # a renderer

            file = options.video / f'{name}_{walk.task.name}.webp'
            write_video(file, walk.recording, Clip(title=f'{name}, {walk.task.name}'))
        bar.advance(work)

    with bar:
        each = len(tasks) + bool(options.trials)
        work = bar.add_task('idle', total=len(sources) * each + len(recorded) + 1)
        idle = idle_power(plant)
        bar.advance(work)
        for walk in recorded:
            add(walk, walk.policy)
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
                add(walk, name)
            if options.trials:
                bar.update(work, description=f'{name}: {options.trials} robots')
                found = _robustness(source, options)
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


def _robustness(source: str, options: argparse.Namespace) -> RobustnessResult | None:
    """Return the robustness of a learned policy; None for a scripted one or a TorchScript file."""
    if source in TROTS or Path(source).is_file():
        return None
    contract, tensors = read_folder(learned_folder(source))
    network = network_of(contract, tensors)
    config = RobustnessConfig(robots=options.trials, seed=1000 + options.seed)
    return evaluate_robustness(contract, network, config, threads=options.threads)
