"""Savings of the paper's pair on other actuators: `python bench/actuators.py [--policies A B]`.

Rows change one thing of the plant `anymal_c_published`; the last is another plant. Nothing is
trained again. Walks of `evaluate`, on what the sensors read. Cells: change of the supply and of
KFE, mean over seeds, and in brackets the seeds with which both walk as asked and how far apart
their speeds are at most.
"""

import argparse
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any, Final

import numpy as np
from policy_training.evaluation.evaluate import score_walk
from policy_training.evaluation.measured_walk import idle_power, measure_walk
from policy_training.evaluation.tasks import TASKS, Task
from sim_bridge.plant.parameters import Plant
from wattwalk_core.engine.options import Workplace
from wattwalk_core.engine.task_engine import TaskEngine

PAIR: Final = ('baseline', 'pmp')
PLANT: Final = 'anymal_c_published'


def changed(**drives: float) -> Plant:
    """Return the plant with parameters of all its drives set, as `loop_bandwidth=50.0`."""
    plant = Plant.load(PLANT)
    types = {kind: replace(drive, **drives) for kind, drive in plant.drive_types.items()}
    return replace(plant, drive_types=types)


def open_loop() -> Plant:
    """Return the plant without torque loop, with the published friction at the rotor."""
    plant = Plant.load(PLANT).with_effects(torque_loop=False)
    types = {
        kind: replace(d, viscous=d.output_viscous, output_viscous=0.0, output_inertia=0.0)
        for kind, d in plant.drive_types.items()
    }
    return replace(plant, drive_types=types)


def plants() -> Mapping[str, Plant]:
    """Return the plant of each row of the table, by a name for its change."""
    plant = Plant.load(PLANT)
    return {
        'nothing': plant,
        'no torque loop': open_loop(),
        **{f'torque loop, {hertz:g} Hz': changed(loop_bandwidth=hertz) for hertz in (20.0, 50.0)},
        'spring 400 N·m/rad': changed(spring_stiffness=400.0),
        'no viscous friction': changed(output_viscous=0.0),
        'no dry friction': plant.with_effects(coulomb_friction=False),
        'no delay': replace(plant, command_delay=0.0),
        'no torque ripple': plant.with_effects(torque_ripple=False),
        'no braking into the supply': changed(regeneration_efficiency=0.0),
        '`anymal_c`': Plant.load('anymal_c'),
    }


Walks = Mapping[str, Mapping[tuple[str, int], dict[str, Any]]]  # by policy, then task and seed


def measure(plant: Plant, policies: tuple[str, ...], seconds: float, seeds: list[int]) -> Walks:
    """Simulate walks of `seconds` on a plant and score them."""
    idle = idle_power(plant)

    def scored(policy: str, task: Task, seed: int) -> dict[str, Any]:
        walk = measure_walk(policy, task, plant, duration=seconds, seed=seed)
        return score_walk(walk, idle, {})

    return {
        policy: {(task.name, seed): scored(policy, task, seed) for task in TASKS for seed in seeds}
        for policy in policies
    }


def row(name: str, found: Walks, policies: tuple[str, ...]) -> str:
    """Return a line of the table: changes in per cent by task, shares, and speeds."""
    first, second = (found[policy] for policy in policies)
    pairs = {key: (first[key], second[key]) for key in first if walks(first[key], second[key])}
    cells = []
    for task in TASKS:
        own = [pair for (kind, _), pair in pairs.items() if kind == task.name]
        if not own:
            cells.append('–')
            continue
        supply, knees = (np.mean([_change(*p, part) for p in own]) for part in ('supply', 'KFE'))
        apart = max(_apart(*pair) for pair in own)
        cells.append(f'{supply:+.0f}, {knees:+.0f} % ({len(own)}; {apart:.2f})')
    if not pairs:
        return f'| {name} | – | – | – | {" | ".join(cells)} |'
    entries = list(pairs.values())
    watts = np.mean([a['power_w']['supply'] for a, _ in entries])
    share = np.mean([a['power_w']['KFE'] / a['power_w']['supply'] for a, _ in entries])
    fast = [
        np.mean([entry['smoothness']['kfe_torque_above_20_hz'] for entry in own])
        for own in zip(*entries, strict=True)
    ]
    return (
        f'| {name} | {watts:.0f} W | {share:.0%} | {fast[0]:.1%}, {fast[1]:.1%} | '
        f'{" | ".join(cells)} |'
    )


def walks(*entries: Mapping[str, Any]) -> bool:
    """Return whether all scored walks track commands within 0.15 (m/s, rad/s), without falls."""
    return all(
        entry['power_w']
        and not entry['falls']
        and max(map(abs, entry['tracking'].values())) < 0.15
        for entry in entries
    )


def _apart(first: Mapping[str, Any], second: Mapping[str, Any]) -> float:
    """Return how far apart two walk, m/s or rad/s."""
    return max(abs(error - second['tracking'][axis]) for axis, error in first['tracking'].items())


def _change(first: Mapping[str, Any], second: Mapping[str, Any], part: str) -> float:
    return 100.0 * (second['power_w'][part] / first['power_w'][part] - 1.0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--policies', nargs=2, default=PAIR, help='the baseline, and the other')
    parser.add_argument('--seconds', type=float, default=12.0)
    parser.add_argument('--seeds', type=int, nargs='+', default=[1, 2])
    options = parser.parse_args()
    policies = tuple(options.policies)
    tasks = ' | '.join(task.name for task in TASKS)
    print(f'| changed | baseline | of it KFE | KFE torque above 20 Hz | {tasks} |')
    print('|---' * (4 + len(TASKS)) + '|')
    named = plants()
    work = partial(measure, policies=policies, seconds=options.seconds, seeds=options.seeds)
    with TaskEngine(Workplace()) as engine:
        for name, found in zip(named, engine.in_order(work, list(named.values())), strict=True):
            print(row(name, found, policies), flush=True)


if __name__ == '__main__':
    main()
