"""Evaluation of policies: measured walks of each task, robustness, gait cycles and a verdict."""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from policy_runner.policies.by_name import learned_folder
from policy_runner.policies.folder import read_folder
from policy_runner.policies.learned import Perceptron
from policy_runner.policies.trot import TROTS
from power_estimator.model import PowerModel
from sim_bridge.plant.parameters import Plant
from wattwalk_core.anymal import GRAVITY, JOINT_TYPES
from wattwalk_core.console import counting_bar, finite

from policy_training.evaluation.gait_cycle import Cycle, cycle_of, fast_share, gait_of
from policy_training.evaluation.measured_walk import (
    RAW_RATE,
    MeasuredWalk,
    columns_of,
    idle_power,
    measure_walk,
)
from policy_training.evaluation.robustness import LIMITS, RobustnessConfig, evaluate_robustness
from policy_training.evaluation.tasks import AXES, Task


def verdict(entries: Sequence[Mapping[str, Any]], trials: Mapping[str, Any]) -> list[str]:
    """Return sentences that compare each policy with the first, by task, and on robustness."""
    names = list(dict.fromkeys(entry['name'] for entry in entries))
    of_first = {e['task']: e for e in reversed(entries) if e['name'] == names[0]}
    sentences = [
        _compare(entry, of_first[entry['task']])
        for name in names[1:]
        for entry in entries
        if entry['name'] == name and entry['task'] in of_first
    ]
    for name, found in trials.items():
        how = ', '.join(f'{key} {found["mean_error"][key]:.2f}' for key in AXES)
        says = 'follows its commands' if found['following'] else 'does not follow its commands'
        sentences.append(
            f'{name} {says}: {found["falls"]} of {found["robots"]} robots fell '
            f'({100 * found["fell_95"][0]:.1f} … {100 * found["fell_95"][1]:.1f} %) in '
            f'{found["seconds"]:.0f} s on rough ground with pushes; off by {how} on average.'
        )
    return sentences


def _compare(entry: Mapping[str, Any], first: Mapping[str, Any]) -> str:
    who = f'{entry["name"]} on {entry["task"]}'
    if not entry['power_w'] or not first['power_w']:
        return f'{who}: nothing to compare, no steady walking.'
    limits = dict(zip(AXES, LIMITS, strict=True))
    astray = [axis for axis in AXES if abs(entry['tracking'][axis]) > limits[axis]]
    here, there = entry['power_w'], first['power_w']
    kinds = [kind for kind in ('KFE', 'HFE', 'HAA') if there[kind] > 1.0]
    parts = [f'{kind} {_change(kind, entry, first)}' for kind in kinds]
    text = (
        f'{who} draws {_change("supply", entry, first)} at the supply '
        f'({here["supply"]:.0f} W against {there["supply"]:.0f} W of {first["name"]}; '
        f'{", ".join(parts)}).'
    )
    if astray:
        text += f' It misses the command in {" and ".join(astray)}: no saving at equal tracking.'
    return text


def _change(part: str, entry: Mapping[str, Any], first: Mapping[str, Any]) -> str:
    """Change of a part in per cent, with the 90 % interval where the walks have one."""
    value, reference = entry['power_w'][part], first['power_w'][part]
    change = 100.0 * (value - reference) / np.abs(reference)
    ends = [one.get('power_interval_w', {}).get(part) for one in (entry, first)]
    if None in ends:
        return f'{_whole(change)} %'
    own, other = (0.5 * (high - low) for low, high in ends)
    half = 100.0 * float(np.hypot(own, other * value / reference)) / np.abs(reference)
    return f'{_whole(change)} % ({_whole(change - half)} … {_whole(change + half)})'


def _whole(percent: float) -> str:
    """A signed whole number, never −0."""
    return f'{np.round(percent) + 0.0:+.0f}'


_WALKING: Final = 0.05  # m/s, slower has no cost of transport
_BLOCK: Final = 1.0  # s, a stride or two: means of these are taken to be independent
_FEWEST: Final = 4  # blocks, of which a spread is said
_NORMAL_90: Final = 1.645


def score_walk(
    walk: MeasuredWalk, idle: float, models: Mapping[str, PowerModel]
) -> dict[str, Any]:
    """Return the entry of `evaluate`'s JSON for a walk; idle: power of all drives at rest, W.

    power_w: `supply` is the power of the bench supply, `electronics` the part that does not reach
    the drives' meters, `idle` the drives at rest, and each joint type that of its four drives
    beyond that. power_interval_w: 90 % of the means over this walk. estimated_w: by the first
    model, for the drives with the electronics measured; estimates has all models by joint type.
    Where nothing was steady, power and tracking are None or empty, and estimates are left out.
    """
    steady, command = walk.steady, walk.task.command
    entry: dict[str, Any] = {
        'name': walk.policy,
        'task': walk.task.name,
        'command': dict(zip(AXES, command, strict=True)),
        'falls': walk.falls,
        'steady_s': round(float(steady.sum() / walk.data.rate), 2),
        'power_w': None,
        'power_interval_w': {},
        'estimated_w': None,
        'tracking': dict.fromkeys(AXES),
        'cost_of_transport': None,
    }
    if not steady.any():
        return entry
    away = np.array(command) - walk.velocity[steady].mean(axis=0)
    entry['tracking'] = dict(zip(AXES, away.tolist(), strict=True))
    drawn = {kind: _of_type(walk, walk.data.power[steady], kind) for kind in JOINT_TYPES}
    supply = float(walk.data.supply[steady].mean())
    electronics = supply - sum(drawn.values())
    entry['power_w'] = {
        'supply': supply,
        'electronics': electronics,
        'idle': idle,
        **{kind: watts - idle / len(JOINT_TYPES) for kind, watts in drawn.items()},
    }
    series = {kind: walk.data.power[:, columns_of(walk.data, kind)] for kind in JOINT_TYPES}
    totals = {kind: power.sum(axis=1) for kind, power in series.items()}
    for part, power in {'supply': walk.data.supply, **totals}.items():
        half = _half_width(walk, power)
        if half is not None:
            mean = entry['power_w'][part]
            entry['power_interval_w'][part] = [mean - half, mean + half]
    entry['estimates'] = {}
    for name, model in models.items():
        data, rows = (walk.data, steady) if model.needs.smooth else (walk.raw, walk.raw_steady)
        power = model.predict(data)[rows]
        by_type = {kind: _of_type(walk, power, kind) for kind in JOINT_TYPES}
        entry['estimates'][name] = {'drives': sum(by_type.values()), **by_type}
    if models:
        entry['estimated_w'] = next(iter(entry['estimates'].values()))['drives'] + electronics
    speed = float(np.hypot(*walk.velocity[steady, :2].mean(axis=0)))
    if speed > _WALKING and max(map(abs, command[:2])) > _WALKING:
        entry['cost_of_transport'] = supply / (walk.mass * GRAVITY * speed)
    entry['gait'] = gait_of(walk)
    entry['smoothness'] = _smoothness(walk)
    return dict(finite(entry))


def _smoothness(walk: MeasuredWalk) -> dict[str, float]:
    raw, kfe = walk.raw, columns_of(walk.raw, 'KFE')
    torque, velocity = raw.torque[walk.raw_steady], raw.velocity[walk.raw_steady]
    jumps = np.abs(np.diff(raw.command.astype(np.float64), axis=0)).sum(axis=0) * RAW_RATE
    return {
        'torque_rms_nm': _rms(torque),
        'kfe_torque_rms_nm': _rms(torque[:, kfe]),
        'kfe_velocity_rms': _rms(velocity[:, kfe]),
        'kfe_torque_above_20_hz': fast_share(walk),
        'target_change_per_s': float(jumps.mean() / len(raw.command)),
    }


def _rms(values: NDArray[np.floating]) -> float:
    return float(np.sqrt(np.mean(np.square(values.astype(np.float64)))))


def _of_type(walk: MeasuredWalk, power: NDArray[np.floating], kind: str) -> float:
    return float(np.nanmean(power[:, columns_of(walk.data, kind)], axis=0).sum())


def _half_width(walk: MeasuredWalk, power: NDArray[np.floating]) -> float | None:
    """Half of the 90 % interval of a mean power [T] over steady walking, by seconds."""
    rows = np.flatnonzero(walk.steady & np.isfinite(power))
    length = round(_BLOCK * walk.data.rate)
    counts = np.bincount(rows // length)
    sums = np.bincount(rows // length, power[rows].astype(np.float64))
    means = sums[counts >= length // 2] / counts[counts >= length // 2]
    if len(means) < _FEWEST:
        return None
    return _NORMAL_90 * float(means.std(ddof=1)) / len(means) ** 0.5


def evaluate(
    sources: Mapping[str, str],
    tasks: Sequence[Task],
    models: Mapping[str, PowerModel],
    plant: Plant,
    options: argparse.Namespace,
    recorded: Sequence[MeasuredWalk] = (),
) -> tuple[dict[str, Any], dict[str, dict[str, Cycle]]]:
    """Evaluate policies on tasks; return the JSON's content, and gait cycles by task and policy.

    sources: names or folders of policies by short name; models: power models by name; options:
    those of the command; recorded: walks that were measured on running nodes.
    """
    entries: list[dict[str, Any]] = []
    cycles: dict[str, dict[str, Cycle]] = {}
    trials: dict[str, Any] = {}
    bar = counting_bar(elapsed=True)

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
                    ideal=options.ideal,
                    trust_code=options.trust_code,
                )
                add(walk, name)
            if options.trials:
                bar.update(work, description=f'{name}: {options.trials} robots')
                found = _robustness(source, options)
                if found is not None:
                    trials[name] = found
                bar.advance(work)
    result = {
        'plant': plant.name,
        'unit': plant.unit_number,
        'ground': 'rough' if options.rough else 'flat',
        'inputs': 'true state' if options.ideal else 'sensors',
        'policies': entries,
        'trials': trials,
    }
    result['verdict'] = verdict(entries, trials)
    return result, cycles


def _robustness(source: str, options: argparse.Namespace) -> dict[str, Any] | None:
    """Return the robustness of a learned policy; None for a scripted one or a TorchScript file."""
    if source in TROTS or Path(source).is_file():
        return None
    contract, tensors = read_folder(learned_folder(source))
    network = Perceptron(tensors, contract.network.activation)
    config = RobustnessConfig(robots=options.trials, seed=1000 + options.seed, plant=options.plant)
    return asdict(evaluate_robustness(contract, network, config, threads=options.threads))
